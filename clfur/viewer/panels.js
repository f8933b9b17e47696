"use strict";
// Files that are dropped on the page, or opened: each is sent as it is, and the server answers in a line.
(() => {
  const LARGEST = MOST;      // bytes of a file
  const SEEN = 6000;         // milliseconds that a line of what was done stays
  const TAKEN = 1000;        // milliseconds after which what was typed is taken, see widgets.py
  let over = 0, shade, chooser, wiped, typed = -TAKEN;

  function start() {
    shade = add("drop-here");
    shade.textContent = "Drop a mesh, a painted type map, strands or a sky";
    chooser = document.body.appendChild(Object.assign(document.createElement("input"), {
      type: "file", multiple: true, accept: "ALLOWED", hidden: true }));
    chooser.addEventListener("change", () => { send([...chooser.files]); chooser.value = ""; });
    document.addEventListener("click", (event) => {
      if (event.target.closest && event.target.closest("[data-open-file]")) chooser.click();
    });
    document.addEventListener("input", (event) => { if (field(event)) typed = performance.now(); });
    for (const end of ["change", "focusout"]) document.addEventListener(end, () => { typed = -TAKEN; });
    window.addEventListener("keydown", key);
    window.addEventListener("dragenter", (event) => count(event, 1));
    window.addEventListener("dragleave", (event) => count(event, -1));
    window.addEventListener("dragover", (event) => event.preventDefault());
    window.addEventListener("drop", (event) => {
      event.preventDefault();
      over = 0;
      shade.classList.remove("over");
      if (event.dataTransfer) send([...event.dataTransfer.files]);
    });
  }

  function add(name) {
    return document.body.appendChild(Object.assign(document.createElement("div"), { className: name }));
  }

  // The field that an event is of, if it holds text.
  function field(event) {
    return event.target.closest && event.target.closest("input:not([type=color], [type=file], [type=range]), textarea");
  }

  // Enter takes what was typed.  Ctrl-Z, and with Shift or as Ctrl-Y the other way; text that is not yet taken has its own.
  function key(event) {
    const name = event.key.toLowerCase(), text = field(event);
    if (name === "enter" && text) text.blur();
    if (!(event.ctrlKey || event.metaKey) || event.altKey || (name !== "z" && name !== "y")) return;
    if (text && performance.now() - typed < TAKEN) return;
    event.preventDefault();
    if (text) text.blur();
    document.querySelector(`[aria-label="${event.shiftKey || name === "y" ? "Redo" : "Undo"}"]`).click();
  }

  function count(event, by) {
    event.preventDefault();
    over = Math.max(over + by, 0);
    const files = event.dataTransfer && [...event.dataTransfer.types].includes("Files");
    shade.classList.toggle("over", over > 0 && !!files);
  }

  async function send(files) {
    for (const file of files) {
      if (file.size > LARGEST) {
        say(`${file.name}: the file has ${(file.size / 2 ** 20).toFixed(1)} MiB; allowed: at most ${LARGEST / 2 ** 20} MiB`, true);
        continue;
      }
      say(`${file.name}: reading …`);
      try {
        const answer = await fetch(`/drop?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file });
        say(`${file.name}: ${(await answer.text()).slice(0, 600)}`, !answer.ok);
      } catch (error) {
        say(`${file.name}: could not be sent`, true);
      }
    }
  }

  function say(line, wrong = false) {
    const said = document.querySelector(".drop-said");   // over the picture, see page.js
    if (!said) return;
    said.textContent = line;
    said.classList.toggle("wrong", wrong);
    clearTimeout(wiped);
    wiped = setTimeout(() => { said.textContent = ""; }, wrong ? 2 * SEEN : SEEN);
  }

  start();
})();
