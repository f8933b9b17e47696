#!/usr/bin/env bash
# Package: usd-core 26.11 (PyPI).
# Input: a stage whose root layer has timeCodesPerSecond = 10; a value is set at time code 10 in the session layer, as a program
#   does that bakes skins or previews a change without touching the file: stage.SetEditTarget(stage.GetSessionLayer()).
# Seen: attribute.Set(1, 10) gives GetTimeSamples() == [4.1666...]: the session layer says nothing of codes a second, has the
#   usual 24, is scaled by 10 / 24 when it is read, and not when it is written. UsdSkel.BakeSkinning does the same. With
#   stage.SetEditTarget(stage.GetEditTargetForLocalLayer(stage.GetSessionLayer())) it is at 10, and so it is at 24 codes a second.
# Why it matters: points that are baked so run 2.4 times too fast, and stand still for the rest of the film; no warning. clfur
#   asks UsdSkel for points at a time and writes none.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv venv
venv/bin/pip install -qq --disable-pip-version-check usd-core==26.11

cat > try.py <<'PY'
from pxr import Sdf, Usd


def samples(codes, mapped):
    stage = Usd.Stage.CreateInMemory()
    stage.SetTimeCodesPerSecond(codes)
    value = stage.DefinePrim("/a").CreateAttribute("x", Sdf.ValueTypeNames.Float)
    layer = stage.GetSessionLayer()
    stage.SetEditTarget(stage.GetEditTargetForLocalLayer(layer) if mapped else layer)
    value.Set(1.0, 10.0)
    print(codes, "codes a second,", "mapped:" if mapped else "as it is:", value.GetTimeSamples())
    return [round(each, 4) for each in value.GetTimeSamples()]


found = samples(10, False), samples(10, True), samples(24, False)
if found != ([4.1667], [10.0], [10.0]):
    raise SystemExit(f"changed: {found}")
PY
venv/bin/python try.py
