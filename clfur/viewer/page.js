"use strict";
// The page's side of the viewer: what a mouse or fingers do is told, at most once an animation frame; a picture that
// comes is drawn in an animation frame, which is told, so that the next one comes.
(() => {
  const DENSEST = 2;        // device pixels a CSS pixel at most
  const WHEEL = 100;        // pixels of scrolling that are one step of zoom
  const AGAIN = 700;        // milliseconds between tries to reach the server
  const RECENT = 1000;      // milliseconds whose pictures are counted,
  const FEWEST = 4;         // or so many pictures, of
  const LONG = 8000;        // so many milliseconds
  const UNKNOWN = 4404;     // how the server closes the socket of a page that it does not know

  const HELP = [
    "drag: turn", "Shift or right button and drag: pan", "wheel: zoom", "double click: back to the first view",
    "drop a file: a mesh, a type map, strands, a sky", "Ctrl-Z: undo"].join("\n");

  const view = window.clfur = { drawn: 0, header: null, bytes: null, told: 0 };   // what was drawn, for who looks
  let stage, canvas, context, status, trouble, socket, opened = false;
  let wish = {}, asked = false;       // what is to be told in the next animation frame
  let last = Promise.resolve();       // of what came: each is taken after the one before
  const held = new Map();             // pointers that are down: id -> [x, y]
  const recent = [];                  // when moving pictures were drawn

  function start() {
    stage = document.getElementById("stage");
    if (!stage) return void requestAnimationFrame(start);   // the page's elements are still being made
    canvas = add("canvas");
    context = canvas.getContext("2d");
    const foot = add("div", "foot");
    foot.append(...["drop-said", "status"].map((name) => Object.assign(document.createElement("div"), { className: name })));
    foot.firstChild.setAttribute("role", "status");   // what panels.js says of files
    status = foot.lastChild;
    trouble = add("div", "trouble");
    const help = add("button", "help");
    help.textContent = "?";
    help.setAttribute("aria-label", "Mouse and keys");
    help.appendChild(Object.assign(document.createElement("span"), { textContent: HELP }));
    for (const event of ["pointerdown", "dblclick"]) help.addEventListener(event, (each) => each.stopPropagation());
    trouble.setAttribute("role", "alert");
    stage.tabIndex = 0;
    stage.addEventListener("pointerdown", press);
    stage.addEventListener("pointermove", move);
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) stage.addEventListener(end, release);
    stage.addEventListener("wheel", wheel, { passive: false });
    stage.addEventListener("dblclick", home);
    stage.addEventListener("contextmenu", (event) => event.preventDefault());
    window.addEventListener("keydown", key);
    document.addEventListener("visibilitychange", () => ask({ hidden: document.hidden }));
    new ResizeObserver(resize).observe(stage);
    connect();
  }

  function add(tag, name = "") {
    const element = document.createElement(tag);
    element.className = name;
    return stage.appendChild(element);
  }

  // What is told -------------------------------------------------------------------------------------------------

  function ask(what) {
    for (const [name, value] of Object.entries(what)) {
      if (name === "turn" || name === "pan") wish[name] = [0, 1].map((k) => (wish[name] ? wish[name][k] : 0) + value[k]);
      else if (name === "zoom") wish.zoom = (wish.zoom || 0) + value;
      else wish[name] = value;
    }
    if (asked) return;
    asked = true;
    if (document.hidden) tell(); else requestAnimationFrame(tell);   // hidden pages have no animation frames
  }

  function tell() {
    asked = false;
    if (!socket || socket.readyState !== WebSocket.OPEN) return;   // what is missing is told when it opens
    if (Object.keys(wish).length) {
      view.told += 1;
      socket.send(JSON.stringify({ n: view.told, ...wish }));
    }
    wish = {};
  }

  function resize() {
    const dense = Math.min(window.devicePixelRatio || 1, DENSEST), box = stage.getBoundingClientRect();
    if (box.width >= 1 && box.height >= 1) ask({ size: [Math.round(box.width * dense), Math.round(box.height * dense)] });
  }

  // Pointers: one turns, with shift or another button it pans; two pan and zoom --------------------------------------

  function press(event) {
    stage.setPointerCapture(event.pointerId);
    stage.focus({ preventScroll: true });
    held.set(event.pointerId, [event.clientX, event.clientY]);
    stage.classList.add("held");
    event.preventDefault();
  }

  function move(event) {
    const before = held.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY], tall = stage.clientHeight || 1;
    const by = [(now[0] - before[0]) / tall, (now[1] - before[1]) / tall];
    if (held.size === 1) {
      ask(event.shiftKey || event.buttons & 6 ? { pan: by } : { turn: by });
    } else {
      const other = [...held].find(([id]) => id !== event.pointerId)[1];
      const apart = (one) => Math.hypot(one[0] - other[0], one[1] - other[1]) || 1;
      ask({ pan: [by[0] / held.size, by[1] / held.size], zoom: Math.log(apart(now) / apart(before)) / Math.log(1.1) });
    }
    held.set(event.pointerId, now);
  }

  function release(event) {
    held.delete(event.pointerId);
    if (!held.size) stage.classList.remove("held");
  }

  function wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 33 : event.deltaMode === 2 ? 300 : 1;
    ask({ zoom: Math.max(-5, Math.min(5, -event.deltaY * lines / WHEEL)) });
  }

  function home() {
    delete wish.turn; delete wish.pan; delete wish.zoom;
    ask({ home: true });
  }

  function key(event) {
    const typing = event.target.closest && event.target.closest("input, textarea, select, [contenteditable]");
    if (event.key === "Home" && !typing) { home(); event.preventDefault(); }
  }

  // The server -------------------------------------------------------------------------------------------------------

  function connect() {
    const key = stage.dataset.window, before = sessionStorage.getItem("clfur-window") || "";
    sessionStorage.setItem("clfur-window", key);
    socket = new WebSocket(`ws://${location.host}/pictures?window=${key}&before=${before}`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      say("");
      opened = true;
      wish = { ...wish, hidden: document.hidden };
      resize();
    };
    socket.onmessage = (event) => { last = last.then(() => take(event.data)); };
    socket.onclose = (event) => {
      if (event.code === UNKNOWN) return location.reload();
      say(opened ? "clfur view does not answer: it has ended, or will be back." : "connecting …");
      setTimeout(opened ? look : connect, AGAIN);
    };
  }

  // Whether the server is there again: then the same page goes on, or, of another server, is loaded anew and says so.
  function look() {
    fetch("/", { method: "HEAD", cache: "no-store" }).then(
      (answer) => (answer.status === 403 ? location.reload() : connect()), () => setTimeout(look, AGAIN));
  }

  async function take(data) {
    const length = new DataView(data).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    if (header.error) return say(header.error);
    if (header.drawing) return status.classList.add("drawing");
    if (!header.picture) return Object.assign(view.header || {}, header);   // of what it shows
    const bytes = new Uint8Array(data, 4 + length);
    try {
      const image = await createImageBitmap(new Blob([bytes], { type: header.final ? "image/png" : "image/jpeg" }));
      await new Promise(requestAnimationFrame);
      draw(header, bytes, image);
    } catch (error) {
      console.error(error);
    }
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ drawn: header.picture }));
  }

  function draw(header, bytes, image) {
    const [width, height] = header.orbit.size;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    context.clearRect(0, 0, width, height);
    context.imageSmoothingQuality = "high";
    context.drawImage(image, 0, 0, width, height);
    image.close();
    Object.assign(view, { drawn: view.drawn + 1, header, bytes });
    say("");
    count(header);
  }

  // What is said -----------------------------------------------------------------------------------------------------

  function count(header) {
    const now = performance.now();
    if (header.final) recent.length = 0; else recent.push(now);
    while (recent.length && recent[0] < now - (recent.length > FEWEST ? RECENT : LONG)) recent.shift();
    const parts = [header.size.join(" × ")];
    if (header.final) {
      parts.push(`${header.seconds.toFixed(2)} s`);
      status.classList.remove("drawing");
    } else if (recent.length > 2) {
      const rate = (recent.length - 1) * 1000 / (now - recent[0]);
      parts.push(`${rate.toFixed(rate < 9.5 ? 1 : 0)} a second`);
    }
    if (header.strands) parts.push(`${header.strands.toLocaleString("en")} strands`);
    parts.push(header.settings, header.device);
    status.replaceChildren(parts.join("  ·  "), Object.assign(document.createElement("span"), { className: "busy" }));
  }

  function say(line) {
    trouble.textContent = line;
    if (line) status.classList.remove("drawing");
  }

  start();
})();
