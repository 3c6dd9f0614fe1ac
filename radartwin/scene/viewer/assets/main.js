// Puts the page together: data, camera, renderer, panel, pointer. #mode=reflectivity in the address opens in that colouring.

const scene = JSON.parse(document.getElementById("scene").textContent);

function array(Kind, text) {
  const bytes = atob(text);
  const out = new Uint8Array(bytes.length);
  for (let k = 0; k < bytes.length; k++) out[k] = bytes.charCodeAt(k);
  return new Kind(out.buffer);
}

function loaded(address) {
  const image = new Image();
  return new Promise((done, failed) => {
    image.onload = () => done(image);
    image.onerror = () => failed(new Error("A picture of the scene's surfaces cannot be read."));
    image.src = address;
  });
}

function start(pictures) {
  const [positions, surface, colours, places, indices] = document.getElementById("arrays").textContent.trim().split("\n");
  const mesh = { positions: array(Float32Array, positions), surface: array(Uint16Array, surface), colours: array(Uint8Array, colours),
    pictures: array(Float32Array, places), indices: array(Uint32Array, indices) };
  const canvas = document.getElementById("canvas");
  const renderer = new Renderer(canvas, mesh, scene.surfaces.length, scene.lines, pictures);
  const camera = new Camera(...scene.frame);
  const hidden = new Set();
  const state = { mode: scene.mode, dollhouse: true, cut: Infinity, waiting: false };

  const panel = new Panel(scene, hidden, (mode) => {
    state.mode = mode;
    panel.show(mode);
    redraw();
  });

  /** A wall hides the room only from behind: its plane has everything on one side, and the eye is on the other. */
  function away(s, eye) {
    return state.dollhouse && s.shell && vec.dot(s.shell.normal, vec.sub(eye, s.shell.point)) < 0;
  }

  function paint() {
    const entries = new Uint8Array(4 * scene.surfaces.length);
    const eye = camera.eye;
    const table = scene.colours[state.mode];
    scene.surfaces.forEach((s, k) => {
      const shown = !hidden.has(k) && !away(s, eye);
      entries.set([...(table ? table[k] : [176, 182, 188]), shown ? (s.crisp ? 255 : 128) : 0], 4 * k);
    });
    renderer.setTable(entries);
  }

  function place() {
    const width = innerWidth, height = innerHeight;
    for (const [k, mark] of scene.marks.entries()) {
      const node = document.getElementById("labels").children[k];
      const [x, y, z] = camera.project(mark.at);
      node.hidden = z > 1 || Math.abs(x) > 1.2 || Math.abs(y) > 1.1;
      node.style.left = `${((x * (1 - camera.shift) - camera.shift) * 0.5 + 0.5) * width}px`;
      node.style.top = `${(0.5 - 0.5 * y) * height}px`;
    }
  }

  function frame() {
    state.waiting = false;
    const ratio = Math.min(devicePixelRatio || 1, 2);
    renderer.resize(Math.round(innerWidth * ratio), Math.round(innerHeight * ratio));
    paint();
    renderer.draw(camera, state.cut, state.mode === "colour");
    place();
    Object.assign(document.body.dataset, { ready: "yes", mode: state.mode });
  }

  function redraw() {
    if (state.waiting) return;
    state.waiting = true;
    requestAnimationFrame(frame);
  }

  function shape() {
    camera.aspect = innerWidth / innerHeight;
    camera.shift = innerWidth > 700 ? 314 / innerWidth : 0;
  }

  function under(event) {
    const ratio = canvas.width / innerWidth;
    return renderer.pick(Math.round(event.clientX * ratio), Math.round(event.clientY * ratio));
  }

  function controls() {
    const [low, high] = [scene.bounds[0][2], scene.bounds[1][2]];
    const cut = document.getElementById("cut");
    const value = document.getElementById("cut-value");
    Object.assign(cut, { min: low, max: high + 0.01, value: high + 0.01 });
    value.textContent = "(nothing)";
    cut.oninput = () => {
      const whole = Number(cut.value) >= high;
      state.cut = whole ? Infinity : Number(cut.value);
      value.textContent = whole ? "(nothing)" : `${Number(cut.value).toFixed(2)} m`;
      redraw();
    };
    document.getElementById("dollhouse").onchange = (event) => {
      state.dollhouse = event.target.checked;
      redraw();
    };
    const views = [["overview", () => camera.overview()], ["top", () => camera.top()]];
    if (scene.radar) views.push(["radar", () => camera.from(scene.radar.position, scene.radar.boresight)]);
    for (const [name, go] of views) {
      const button = element("button", { id: `view-${name}`, type: "button", textContent: name });
      button.onclick = () => (go(), redraw());
      document.getElementById("views").append(button);
    }
  }

  function pointer() {
    let held = null;
    canvas.onpointerdown = (event) => {
      held = { x: event.clientX, y: event.clientY, pan: event.shiftKey || event.button !== 0 };
      canvas.setPointerCapture(event.pointerId);
      showCard(null);
    };
    canvas.onpointerup = () => (held = null);
    canvas.onpointermove = (event) => {
      if (!held) return showCard(scene.surfaces[under(event)], event.clientX, event.clientY);
      const [dx, dy] = [event.clientX - held.x, event.clientY - held.y];
      held.pan ? camera.pan(dx, dy, innerHeight) : camera.turn(dx, dy);
      Object.assign(held, { x: event.clientX, y: event.clientY });
      redraw();
    };
    canvas.onpointerleave = () => showCard(null);
    canvas.oncontextmenu = (event) => event.preventDefault();
    canvas.ondblclick = (event) => {
      const found = scene.surfaces[under(event)];
      if (found) camera.target = [...found.centre];
      redraw();
    };
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      camera.nearer(Math.exp(Math.sign(event.deltaY) * Math.min(Math.abs(event.deltaY), 100) * 0.0015));
      redraw();
    }, { passive: false });
  }

  for (const mark of scene.marks) {
    const node = element("span", { textContent: mark.text });
    node.style.color = css(mark.colour);
    document.getElementById("labels").append(node);
  }
  document.getElementById("title").textContent = scene.title;
  document.getElementById("note").textContent = scene.note;
  shape();
  camera.overview();
  controls();
  pointer();
  const asked = new URLSearchParams(location.hash.slice(1)).get("mode");
  panel.changed(asked in scene.colours || (asked === "colour" && scene.has_colour) ? asked : state.mode);
  addEventListener("resize", () => (shape(), redraw()));
}

Promise.all(scene.pictures.map(loaded)).then(start).catch((error) => {
  document.body.replaceChildren(element("p", { className: "failure", textContent: `The scene cannot be drawn. ${error.message}` }));
  throw error;
});
