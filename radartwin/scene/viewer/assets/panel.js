// The panel beside the picture (colouring, legend) and the card with the facts of the surface under the pointer.

function element(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) key in node ? (node[key] = value) : node.setAttribute(key, value);
  node.append(...children);
  return node;
}

const css = (colour) => `rgb(${colour.join(",")})`;
const area = (m2) => (m2 >= 100 ? m2.toFixed(0) : m2 >= 1 ? m2.toFixed(1) : m2.toPrecision(2)) + " m²";
const MODES = { material: "material", segment: "segment", reflectivity: "reflectivity", colour: "scan colour" };

class Panel {
  /** hidden: numbers of the surfaces that the user hides; changed: function called after a change of `hidden` or of the mode. */
  constructor(scene, hidden, changed) {
    Object.assign(this, { scene, hidden, changed });
    this.node = document.getElementById("legend");
    this.buttons = {};
    for (const [mode, text] of Object.entries(MODES)) {
      const missing = mode === "colour" && !scene.has_colour;
      const title = missing ? "this scene has no colours of a scan" : "";
      const button = element("button", { id: `mode-${mode}`, type: "button", textContent: text, disabled: missing, title });
      button.onclick = () => this.changed(mode);
      document.getElementById("modes").append(button);
      this.buttons[mode] = button;
    }
  }

  show(mode) {
    this.mode = mode;
    for (const [name, button] of Object.entries(this.buttons)) button.setAttribute("aria-pressed", String(name === mode));
    const fill = { material: () => this.materials(), segment: () => this.segments(), reflectivity: () => this.ramp() }[mode];
    this.node.replaceChildren(...(fill ? fill() : this.photograph()));
  }

  rows(entries) {
    return element("ul", {}, ...entries.map(({ label, colour, amount, members }) => {
      const row = element("li", { title: "click to hide or show" },
        element("span", { className: "swatch" }), element("span", { className: "label", textContent: label }),
        element("span", { className: "amount", textContent: amount }));
      row.firstChild.style.background = css(colour);
      row.classList.toggle("hidden", members.every((k) => this.hidden.has(k)));
      row.onclick = () => {
        const hide = !members.every((k) => this.hidden.has(k));
        members.forEach((k) => (hide ? this.hidden.add(k) : this.hidden.delete(k)));
        this.changed(this.mode);
      };
      return row;
    }));
  }

  materials() {
    const entries = this.scene.materials.map(({ label, colour }) => {
      const members = this.scene.surfaces.flatMap((s, k) => (s.material === label ? [k] : []));
      const total = members.reduce((sum, k) => sum + this.scene.surfaces[k].area_m2, 0);
      return { label, colour, members, amount: area(total) };
    });
    return [element("h2", { textContent: "Material" }), this.rows(entries)];
  }

  segments() {
    const order = this.scene.surfaces.map((s, k) => k).sort((a, b) => this.scene.surfaces[b].area_m2 - this.scene.surfaces[a].area_m2);
    const entries = order.map((k) => {
      const { name, area_m2 } = this.scene.surfaces[k];
      return { label: name, colour: this.scene.colours.segment[k], members: [k], amount: area(area_m2) };
    });
    return [element("h2", { textContent: `${entries.length} segments by area` }), this.rows(entries)];
  }

  ramp() {
    const { stops, low_db, ticks_db, band, unknown } = this.scene.ramp;
    const bar = element("div", { id: "bar" }, element("div", { className: "ramp" }), element("div", { className: "ticks" }));
    bar.firstChild.style.background = `linear-gradient(to top, ${stops.map(css).join(",")})`;
    for (const tick of ticks_db) {
      const last = tick === low_db ? `${tick} dB or less` : tick === 0 ? "0 dB, a perfect mirror" : `${tick} dB`;
      const mark = element("span", { textContent: last.replace("-", "−") });
      mark.style.bottom = `${100 * (1 - tick / low_db)}%`;
      bar.lastChild.append(mark);
    }
    const notes = [element("p", { textContent: `Power reflected at normal incidence, mean over ${band}, roughness included.` })];
    if (this.scene.surfaces.some((s) => s.reflection_db === null)) {
      const swatch = element("span", { className: "swatch" });
      swatch.style.cssText = `display:inline-block;vertical-align:-3px;background:${css(unknown)}`;
      notes.push(element("p", {}, swatch, " no values at this frequency"));
    }
    return [element("h2", { textContent: "Reflectivity" }), bar, ...notes];
  }

  photograph() {
    const bare = this.scene.surfaces.some((s) => !s.has_colour);
    const filled = this.scene.has_filled ? " Unscanned areas that were filled in are hatched grey." : "";
    const note = (bare ? "Colours of the scan; surfaces without a colour are grey." : "Colours of the scan.") + filled;
    return [element("h2", { textContent: "Scan colour" }), element("p", { textContent: note })];
  }
}

/** Show the card with the facts of a surface beside the pointer. */
function showCard(surface, x, y) {
  const card = document.getElementById("card");
  card.hidden = !surface;
  if (!surface) return;
  const facts = surface.facts.flatMap(([key, value]) => [element("dt", { textContent: key }),
    element("dd", { textContent: value, className: key === "substitute" && value !== "no" ? "stand-in" : "" })]);
  card.replaceChildren(element("h2", { textContent: surface.name }), element("dl", {}, ...facts));
  card.style.left = "0"; // so that the edge of the window does not narrow the card
  card.style.left = `${Math.min(x + 16, innerWidth - card.offsetWidth - 8)}px`;
  card.style.top = `${Math.min(y + 16, innerHeight - card.offsetHeight - 8)}px`;
}
