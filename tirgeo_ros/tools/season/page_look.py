"""Hold the season's page's own style, in light and dark, narrow and wide; and what sorts it."""

from __future__ import annotations

STYLE = """
:root { color-scheme: light dark; --run: #2e8b57; --warn: #d08a00; --bad: #c0392b;
  --idle: #9aa0a6; --link: #0b63b0; }
body { max-width: 110rem; }
a { color: var(--link); }
.totals { display: flex; flex-wrap: wrap; gap: .6rem 2rem; margin: 1rem 0; padding: 0; }
.totals div { min-width: 7rem; }
.totals dt { color: var(--soft); font-size: .85rem; }
.totals dd { margin: 0; font-size: 1.15rem; font-weight: 600; }
.totals .wide { flex: 1 1 18rem; font-size: .9rem; }
.totals .wide dd { font-size: .9rem; font-weight: 400; }
.bar { display: flex; height: .5rem; border-radius: .25rem; overflow: hidden; margin: .3rem 0;
  min-width: 6rem; }
.bar i { background: var(--idle); }
.bar .running { background: var(--run); }
.bar .degraded, .bar .dead_reckoning { background: var(--warn); }
.bar .lost { background: var(--bad); }
b.stop { color: var(--bad); }
b.caution { color: var(--warn); }
b.note { color: var(--soft); font-weight: 400; }
.maps { display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fill, minmax(min(100%, 18rem), 1fr)); }
.maps svg { width: 100%; border: 1px solid var(--line); border-radius: .4rem; }
.maps polyline { fill: none; stroke: var(--link); stroke-width: 1.3; stroke-opacity: .75; }
.maps circle { fill: var(--run); }
.maps a:hover polyline, .maps a:focus polyline { stroke: var(--bad); stroke-opacity: 1; }
.scale { fill: none; stroke: currentColor; }
.maps text { fill: currentColor; font-size: 11px; }
table { width: 100%; font-size: .88rem; }
th, td { text-align: left; vertical-align: top; padding: .4rem .6rem; overflow-wrap: normal; }
td:last-child { overflow-wrap: anywhere; }
.line { white-space: nowrap; }
th { position: sticky; top: 0; background: var(--paper); z-index: 1; white-space: nowrap; }
th button { font: inherit; font-weight: 600; color: inherit; background: none; border: 0;
  padding: 0; cursor: pointer; }
th[aria-sort=ascending] button::after { content: " \\25b2"; }
th[aria-sort=descending] button::after { content: " \\25bc"; }
td:first-child { min-width: 9rem; overflow-wrap: anywhere; }
td:first-child img { display: block; width: 8rem; max-width: 100%; border-radius: .3rem; }
td:first-child strong, td:first-child span { display: block; }
td:nth-child(5) { min-width: 9rem; }
td:nth-child(9) { max-width: 16rem; }
tr:target { outline: 2px solid var(--link); }
details ul { padding-left: 1rem; margin: .3rem 0; }
summary { cursor: pointer; white-space: nowrap; }
.sort { display: none; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e6e6; --paper: #16181b; --soft: #a3a8ae; --line: #3a3f45; --fine: #2a2e33;
    --fault: #3a1f1d; --run: #4fbf85; --warn: #e5a93b; --bad: #ff7b6b; --link: #7fb8f0; }
}
@media (max-width: 60rem) {
  .sort { display: block; margin: .5rem 0; }
  .sort select { font: inherit; padding: .4rem; }
  thead { display: none; }
  table, tbody { display: block; }
  tr { display: grid; grid-template-columns: 1fr; border: 1px solid var(--line);
    border-radius: .5rem; padding: .5rem .7rem; margin: .8rem 0; }
  td { display: grid; grid-template-columns: 5.5rem 1fr; border: 0; padding: .15rem 0; }
  td::before { content: attr(data-title); color: var(--soft); }
  td > div { min-width: 0; }
  td:first-child { display: block; }
  td:first-child::before { content: none; }
  td:first-child img { width: 100%; max-width: 24rem; }
  td:first-child strong { font-size: 1.1rem; margin-top: .3rem; }
  td:first-child a { display: inline-block; padding: .4rem .8rem .4rem 0; }
  summary { white-space: normal; }
}
"""

#: Sorts the rows by the values that the cells carry; the page is whole without it.
SCRIPT = """
const body = document.querySelector("tbody");
const heads = [...document.querySelectorAll("th")];
const choice = document.querySelector(".sort select");
function sorted(column, down) {
  const value = (row) => {
    const text = row.cells[column].dataset.key;
    return column > 1 ? Number(text) : text; // the first two are names and times
  };
  const order = (a, b) => (value(a) < value(b) ? -1 : value(a) > value(b) ? 1 : 0);
  const rows = [...body.rows].sort((a, b) => (down ? order(b, a) : order(a, b)));
  body.append(...rows);
  heads.forEach((head) => head.removeAttribute("aria-sort"));
  heads[column].setAttribute("aria-sort", down ? "descending" : "ascending");
  choice.value = `${column} ${down ? 1 : 0}`;
}
heads.forEach((head, column) => head.firstElementChild.addEventListener("click", () =>
  sorted(column, head.getAttribute("aria-sort") === "ascending")));
choice.addEventListener("change", () => {
  const [column, down] = choice.value.split(" ").map(Number);
  sorted(column, down === 1);
});
"""
