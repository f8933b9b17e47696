// A scene that turns with the mouse: asks the kernel for a picture, draws it, and only then asks for the next.
const REST = 120;   // milliseconds without a movement, after which the final picture is asked for
const LINE = 3;     // steps of the wheel that some browsers count as lines are this many
const PIXELS = 100; // and as pixels about this many

function render({ model, el }) {
  const canvas = document.createElement("canvas");
  const line = document.createElement("div");
  line.textContent = "drawing ...";
  canvas.style.cssText = "display: block; max-width: 100%; cursor: grab; touch-action: none";
  el.append(canvas, line);
  let moves = null;      // what the mouse has done since the kernel was asked last
  let waiting = false;   // for a picture of the camera as it moves
  let timer = 0, place = null, last = Promise.resolve();

  function ask() {
    if (waiting || !moves) return;
    waiting = true;
    model.send(moves);
    moves = null;
  }

  function move(name, x, y) {
    clearTimeout(timer);
    moves ??= {};
    if (name === "reset") moves = { reset: true };
    else if (name === "zoom") moves.zoom = (moves.zoom ?? 0) + x;
    else moves[name] = [(moves[name]?.[0] ?? 0) + x, (moves[name]?.[1] ?? 0) + y];
    requestAnimationFrame(ask);
  }

  async function draw(content, buffers) {
    line.textContent = content.error ?? "";
    if (!content.error) {
      const picture = await createImageBitmap(new Blob([buffers[0]], { type: "image/png" }));
      if (content.final) [canvas.width, canvas.height] = [picture.width, picture.height];
      const context = canvas.getContext("2d");
      context.clearRect(0, 0, canvas.width, canvas.height);
      context.drawImage(picture, 0, 0, canvas.width, canvas.height);
      picture.close();
    }
    if (content.final) return;
    waiting = false;
    clearTimeout(timer);
    if (moves) requestAnimationFrame(ask);   // not in a window that nobody sees
    else if (!content.error) timer = setTimeout(() => model.send({ rest: true }), REST);
  }

  const take = (content, buffers) => { last = last.then(() => draw(content, buffers)); };
  model.on("msg:custom", take);

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    place = [event.clientX, event.clientY];
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!place || !canvas.clientHeight) return;
    const [x, y] = [event.clientX - place[0], event.clientY - place[1]];
    place = [event.clientX, event.clientY];
    move(event.shiftKey ? "pan" : "turn", x / canvas.clientHeight, y / canvas.clientHeight);
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { place = null; });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    move("zoom", -event.deltaY / (event.deltaMode ? LINE : PIXELS));
  }, { passive: false });
  canvas.addEventListener("dblclick", () => move("reset"));

  model.send({ rest: true });
  return () => {
    clearTimeout(timer);
    model.off("msg:custom", take);
  };
}

export default { render };
