"use strict";
// The page works without this script, which adds sorting and filtering of tables.
const make = (name, properties = {}, ...children) => {
  const one = Object.assign(document.createElement(name), properties);
  one.append(...children);
  return one;
};
const LONG = 8; // a table with fewer rows has no filter

function sortable(table) {
  const heads = [...table.tHead.rows[0].cells], body = table.tBodies[0], given = [...body.rows];
  const value = (row, k) => {
    const text = row.cells[k].textContent.trim(), figure = Number.parseFloat(text.replace(/\u2212/g, "-").replace(/(?<=\d),(?=\d{3})/g, ""));
    return [Number.isNaN(figure), figure, text];
  };
  heads.forEach((head, k) => {
    const button = make("button", {type: "button"}, ...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const next = {none: "ascending", ascending: "descending", descending: "none"}[head.getAttribute("aria-sort") || "none"];
      heads.forEach(one => one.removeAttribute("aria-sort"));
      if (next === "none") { body.append(...given); return; }
      head.setAttribute("aria-sort", next);
      const sign = next === "ascending" ? 1 : -1, keys = new Map(given.map(row => [row, value(row, k)]));
      const order = (a, b) => {
        const [wordA, figureA, textA] = keys.get(a), [wordB, figureB, textB] = keys.get(b);
        if (wordA !== wordB) return wordA ? 1 : -1; // text comes after numbers in both orders
        return sign * (wordA ? textA.localeCompare(textB) : figureA - figureB);
      };
      body.append(...[...given].sort(order));
    });
  });
}

function filterable(table) {
  const rows = [...table.tBodies[0].rows];
  if (rows.length < LONG) return;
  const words = make("input", {type: "search", placeholder: "words to find", autocomplete: "off"}), count = make("output");
  const verdict = make("select", {}, make("option", {value: ""}, "all verdicts"));
  const kinds = [...new Set(rows.map(row => row.className))].filter(Boolean); // the class of a row is its verdict
  for (const kind of kinds) verdict.append(make("option", {value: kind}, kind.replaceAll("-", " ")));
  const apply = () => {
    const searched = words.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const row of rows) {
      const text = searched.length ? row.textContent.toLowerCase() : "";
      const shown = (!verdict.value || row.classList.contains(verdict.value)) && searched.every(word => text.includes(word));
      row.classList.toggle("filtered", !shown);
    }
    const left = rows.filter(row => !row.classList.contains("filtered")).length;
    count.textContent = left === rows.length ? `${left} rows` : `${left} of ${rows.length} rows`;
    table.dispatchEvent(new CustomEvent("filtered", {detail: verdict.value}));
  };
  const tools = make("div", {className: "tools"}, make("label", {}, "Filter ", words));
  if (kinds.length > 1) tools.append(make("label", {}, "Verdict ", verdict));
  tools.append(count);
  table.closest(".scroll").before(tools);
  words.addEventListener("input", apply);
  verdict.addEventListener("change", apply);
  table.addEventListener("choose", event => { verdict.value = event.detail; words.value = ""; apply(); });
  count.textContent = `${rows.length} rows`;
}

// A folded table becomes sortable and filterable when it is first unfolded.
for (const table of document.querySelectorAll("table[data-tools]")) {
  const folded = table.closest("details:not([open])"), prepare = () => { sortable(table); filterable(table); };
  if (folded) folded.addEventListener("toggle", prepare, {once: true}); else prepare();
}

// The counts of the summary become buttons that filter the claims.
for (const cards of document.querySelectorAll("[data-filter]")) {
  const table = document.getElementById(cards.dataset.filter);
  const buttons = [...cards.children].map(card => {
    const button = make("button", {type: "button"}, ...card.childNodes);
    button.dataset.verdict = card.className;
    button.setAttribute("aria-pressed", "false");
    button.addEventListener("click", () => {
      const on = button.getAttribute("aria-pressed") === "true";
      table.dispatchEvent(new CustomEvent("choose", {detail: on ? "" : button.dataset.verdict}));
    });
    card.append(button);
    return button;
  });
  table.addEventListener("filtered", event => {
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.verdict === event.detail));
  });
}

// A link to a row unfolds its table and shows the row even if a filter hides it.
function reveal() {
  const row = location.hash.length > 1 && document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (!row) return;
  row.classList.remove("filtered");
  const folded = row.closest("details");
  if (folded && !folded.open) { folded.open = true; row.scrollIntoView(); }
}
addEventListener("hashchange", reveal);
reveal();

// On a narrow screen the contents start folded; in print everything is unfolded.
if (matchMedia("(max-width: 68rem)").matches) document.querySelector("#contents details").open = false;
let folded = [];
addEventListener("beforeprint", () => {
  folded = [...document.querySelectorAll("details:not([open])")];
  for (const one of folded) one.open = true;
  for (const picture of document.querySelectorAll("img[loading=lazy]")) picture.loading = "eager";
});
addEventListener("afterprint", () => { for (const one of folded) one.open = false; });
document.body.dataset.ready = "yes";
