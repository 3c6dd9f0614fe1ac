"use strict";
// The page works without this script, which sorts and filters tables and shows the row that a link names.
const make = (name, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(name), properties);
  element.append(...children);
  return element;
};
const LONG = 8; // a table with fewer rows has no filter

function sortable(table) {
  const heads = [...table.tHead.rows[0].cells], body = table.tBodies[0], given = [...body.rows];
  const value = (row, k) => {
    const text = row.cells[k].textContent.trim(), number = Number.parseFloat(text.replace(/\u2212/g, "-").replace(/(?<=\d),(?=\d{3})/g, ""));
    return [Number.isNaN(number), number, text];
  };
  heads.forEach((head, k) => {
    const button = make("button", {type: "button"}, ...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const next = {none: "ascending", ascending: "descending", descending: "none"}[head.getAttribute("aria-sort") || "none"];
      heads.forEach(other => other.removeAttribute("aria-sort"));
      if (next === "none") { body.append(...given); return; }
      head.setAttribute("aria-sort", next);
      const sign = next === "ascending" ? 1 : -1, keys = new Map(given.map(row => [row, value(row, k)]));
      body.append(...[...given].sort((a, b) => {
        const [wordA, numberA, textA] = keys.get(a), [wordB, numberB, textB] = keys.get(b);
        if (wordA !== wordB) return wordA ? 1 : -1; // text comes after numbers in both orders
        return sign * (wordA ? textA.localeCompare(textB) : numberA - numberB);
      }));
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
      row.classList.toggle("filtered", !((!verdict.value || row.classList.contains(verdict.value)) && searched.every(word => text.includes(word))));
    }
    const left = rows.filter(row => !row.classList.contains("filtered")).length;
    count.textContent = left === rows.length ? "" : `${left} of ${rows.length} rows`;
  };
  const tools = make("span", {className: "tools"}, make("label", {}, "Filter ", words));
  if (kinds.length > 1) tools.append(make("label", {}, "Verdict ", verdict));
  tools.append(count);
  table.closest("section").querySelector(".verdicts").append(tools);
  words.addEventListener("input", apply);
  verdict.addEventListener("change", apply);
  table.addEventListener("choose", event => { verdict.value = event.detail; words.value = ""; apply(); });
}

for (const table of document.querySelectorAll("table[data-tools]")) { sortable(table); filterable(table); }
for (const link of document.querySelectorAll("a[data-verdict]")) link.addEventListener("click", () =>
  document.querySelector(`${link.hash} table[data-tools]`).dispatchEvent(new CustomEvent("choose", {detail: link.dataset.verdict})));

// A link to a row unfolds what hides the row, shows all its columns, and scrolls to it even if a filter hides it.
function reveal() {
  const target = location.hash.length > 1 && document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (!target) return;
  for (let folded = target.closest("details"); folded; folded = folded.parentElement.closest("details")) folded.open = true;
  if (target.matches("section.table tr")) {
    target.classList.remove("filtered");
    target.closest("section").querySelector(".columns input").checked = true;
  }
  // Sections below a folded part get their heights only after they are drawn, so the page scrolls again then.
  if (target.matches("tr")) for (const wait of [0, 100, 300]) setTimeout(() => target.scrollIntoView({block: "center"}), wait);
}
addEventListener("hashchange", reveal);
reveal();

// On a narrow screen the contents start folded; in print everything is unfolded.
if (matchMedia("(max-width: 68rem)").matches) document.querySelector("#contents details").open = false;
let folded = [];
addEventListener("beforeprint", () => {
  folded = [...document.querySelectorAll("details:not([open])")];
  for (const details of folded) details.open = true;
});
addEventListener("afterprint", () => { for (const details of folded) details.open = false; });
document.body.dataset.ready = "yes";
