#!/usr/bin/env bash
# Packages: distributed 2026.8.0 (PyPI), Python 3.11, Linux.
# Input: `dask scheduler --host tcp://127.0.0.1 --port 18786 --no-dashboard`, all on loopback; then the sockets that the
#   process listens on, and its HTTP server asked at /health.
# Seen: it listens on 127.0.0.1:18786, and an HTTP server on 0.0.0.0:8787, which answers "ok" on every interface: --host
#   is not its host, and --no-dashboard leaves the server on. With --dashboard-address 127.0.0.1:0 it is on loopback alone.
# Why it matters: who renders on a private net binds the scheduler to it (whoever reaches it runs code) and takes all of it
# to be bound there. Give --dashboard-address as well.
set -euo pipefail
dir=$(mktemp -d)
trap 'kill $(jobs -p) 2>/dev/null || true; wait; rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv venv
venv/bin/pip install -qq --disable-pip-version-check distributed==2026.8.0 dask==2026.8.0

cat > listening.py <<'PY'
import sys
import time
import urllib.request

import psutil

process = psutil.Process(int(sys.argv[1]))
for _ in range(300):
    sockets = sorted({(each.laddr.ip, each.laddr.port) for each in process.net_connections()
                      if each.status == psutil.CONN_LISTEN})
    if len(sockets) == 2:
        break
    time.sleep(0.2)
print(sockets)
web = next(port for _, port in sockets if port != 18786)
print("health:", urllib.request.urlopen(f"http://127.0.0.1:{web}/health").read().decode())
PY

for more in "" "--dashboard-address 127.0.0.1:0"; do
    echo "dask scheduler --host tcp://127.0.0.1 --port 18786 --no-dashboard $more"
    # shellcheck disable=SC2086
    venv/bin/dask scheduler --host tcp://127.0.0.1 --port 18786 --no-dashboard $more > log 2>&1 &
    venv/bin/python listening.py $!
    kill $!
    wait $! || true
done
