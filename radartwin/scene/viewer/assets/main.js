// Connects data, camera, renderer, panel and pointer. "#mode=reflectivity" in the address selects the first colouring.

const TAP_PX = 6; // a pointer that moves less far clicks or taps, and does not drag
const scene = JSON.parse(document.getElementById("scene").textContent);

function decoded(Kind, text) {
  const bytes = atob(text);
  const out = new Uint8Array(bytes.length);
  for (let k = 0; k < bytes.length; k++) out[k] = bytes.charCodeAt(k);
  return new Kind(out.buffer);
}

async function loadedImage(address) {
  const image = Object.assign(new Image(), { src: address });
  await image.decode().catch(() => { throw new Error("A texture of the scene cannot be read."); });
  return image;
}

function start(pictures) {
  const [positions, surface, colours, coordinates, indices] = document.getElementById("arrays").textContent.trim().split("\n");
  const mesh = { positions: decoded(Float32Array, positions), surface: decoded(Uint16Array, surface), colours: decoded(Uint8Array, colours),
    pictures: decoded(Float32Array, coordinates), indices: decoded(Uint32Array, indices) };
  const canvas = document.getElementById("canvas");
  const renderer = new Renderer(canvas, mesh, scene.surfaces.length, scene.lines, pictures);
  const camera = new Camera(...scene.frame);
  const hidden = new Set();
  const state = { mode: scene.mode, hideWalls: true, cut: Infinity, pending: false };

  const panel = new Panel(scene, hidden, (mode) => {
    state.mode = mode;
    panel.show(mode);
    redraw();
  });

  /** Whether a wall is seen from outside the room. */
  function fromOutside(s, eye) {
    return s.wall && vec.dot(s.wall.normal, vec.sub(eye, s.wall.point)) < 0;
  }

  function updateColours() {
    const entries = new Uint8Array(4 * scene.surfaces.length);
    const eye = camera.eye;
    const table = scene.colours[state.mode];
    scene.surfaces.forEach((s, k) => {
      const shown = !hidden.has(k) && !(state.hideWalls && fromOutside(s, eye));
      entries.set([...(table ? table[k] : [176, 182, 188]), shown ? (s.crisp ? 255 : 128) : 0], 4 * k);
    });
    renderer.setTable(entries);
  }

  function moveLabels() {
    const { clientWidth: width, clientHeight: height, offsetTop } = canvas;
    for (const [k, label] of scene.labels.entries()) {
      const node = document.getElementById("labels").children[k];
      const [x, y, z] = camera.project(label.at);
      node.hidden = z > 1 || Math.abs(x) > 1.2 || Math.abs(y) > 1.1;
      node.style.left = `${((x * (1 - camera.shift) - camera.shift) * 0.5 + 0.5) * width}px`;
      node.style.top = `${offsetTop + (0.5 - 0.5 * y) * height}px`;
    }
  }

  function frame() {
    state.pending = false;
    const ratio = Math.min(devicePixelRatio || 1, 2);
    renderer.resize(Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio));
    updateColours();
    renderer.draw(camera, state.cut, state.mode === "colour");
    moveLabels();
    Object.assign(document.body.dataset, { ready: "yes", mode: state.mode });
  }

  function redraw() {
    if (state.pending) return;
    state.pending = true;
    requestAnimationFrame(frame);
  }

  function updateAspect() {
    camera.resize(canvas.clientWidth / canvas.clientHeight, innerWidth > 700 ? 314 / innerWidth : 0);
  }

  function surfaceAt(event) {
    const ratio = canvas.width / canvas.clientWidth;
    return scene.surfaces[renderer.pick(Math.round(event.clientX * ratio), Math.round((event.clientY - canvas.offsetTop) * ratio))];
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
    document.getElementById("hide-walls").onchange = (event) => {
      state.hideWalls = event.target.checked;
      redraw();
    };
    const views = [["overview", () => camera.overview()], ["top", () => camera.top()]];
    if (scene.radar) views.push(["radar", () => camera.lookFrom(scene.radar.position, scene.radar.boresight)]);
    for (const [name, go] of views) {
      const button = element("button", { id: `view-${name}`, type: "button", textContent: name });
      button.onclick = () => (go(), redraw());
      document.getElementById("views").append(button);
    }
  }

  function pointer() {
    const down = new Map(); // positions of the pointers that are down, by their ids
    let way = 0; // pixels that the pointers have moved since the first went down
    canvas.onpointerdown = (event) => {
      way = down.size ? Infinity : 0;
      down.set(event.pointerId, [event.clientX, event.clientY, 0]);
      canvas.setPointerCapture(event.pointerId);
    };
    canvas.onpointerup = (event) => {
      down.delete(event.pointerId);
      if (way < TAP_PX) showCard(surfaceAt(event), event.clientX, event.clientY);
    };
    canvas.onpointercancel = (event) => down.delete(event.pointerId);
    canvas.onpointermove = (event) => {
      const last = down.get(event.pointerId);
      if (!last) return showCard(surfaceAt(event), event.clientX, event.clientY);
      const here = [event.clientX, event.clientY, 0];
      const [dx, dy] = vec.sub(here, last);
      down.set(event.pointerId, here);
      way += Math.hypot(dx, dy);
      if (way < TAP_PX) return;
      showCard(null);
      if (down.size > 1) {
        const other = [...down].find(([id]) => id !== event.pointerId)[1];
        camera.zoom(Math.hypot(...vec.sub(last, other)) / Math.max(Math.hypot(...vec.sub(here, other)), 1));
        camera.pan(dx / 2, dy / 2, canvas.clientHeight);
      } else if (event.shiftKey || event.buttons > 1) camera.pan(dx, dy, canvas.clientHeight);
      else camera.turn(dx, dy);
      redraw();
    };
    canvas.onpointerleave = (event) => event.pointerType === "mouse" && showCard(null); // a finger leaves when it is lifted
    canvas.oncontextmenu = (event) => event.preventDefault();
    canvas.ondblclick = (event) => {
      const surface = surfaceAt(event);
      if (surface) Object.assign(camera, { target: [...surface.centre], fitted: false });
      redraw();
    };
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      camera.zoom(Math.exp(Math.sign(event.deltaY) * Math.min(Math.abs(event.deltaY), 100) * 0.0015));
      redraw();
    }, { passive: false });
  }

  for (const label of scene.labels) {
    const node = element("span", { textContent: label.text });
    node.style.color = css(label.colour);
    document.getElementById("labels").append(node);
  }
  document.getElementById("title").textContent = scene.title;
  document.getElementById("note").textContent = scene.note;
  updateAspect();
  controls();
  pointer();
  const mode = new URLSearchParams(location.hash.slice(1)).get("mode");
  panel.changed(mode in scene.colours || (mode === "colour" && scene.has_colour) ? mode : state.mode);
  addEventListener("resize", () => (updateAspect(), redraw()));
}

Promise.all(scene.pictures.map(loadedImage)).then(start).catch((error) => {
  document.body.replaceChildren(element("p", { className: "failure", textContent: `The scene cannot be drawn. ${error.message}` }));
  throw error;
});
