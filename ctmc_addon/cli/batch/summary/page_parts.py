# SPDX-License-Identifier: GPL-3.0-or-later
"""The style and the script of summary.html. The script only shows, hides and sorts what is there."""

STYLE = """
:root{--ink:#222;--paper:#fff;--line:#ddd;--soft:#777;--bad:#b00020;--mark:#fff3cd;--bar:#4a7ba6;
color-scheme:light dark}
@media(prefers-color-scheme:dark){:root{--ink:#ddd;--paper:#181a1b;--line:#3a3d3f;--soft:#999;--bad:#ff8a80;--mark:#4a3c10;
--bar:#7fb0dc}}
body{font:15px system-ui,sans-serif;margin:2em;color:var(--ink);background:var(--paper)}a{color:inherit}
table{border-collapse:collapse;margin:1em 0}th,td{padding:.3em .8em;border-bottom:1px solid var(--line);text-align:left;
vertical-align:top}#cases{font-size:14px}#cases th,#cases td{padding:.3em .35em}summary{white-space:nowrap}
#cases td:nth-child(2){min-width:7em}#cases thead th{position:sticky;top:0;background:var(--paper)}
td.number,th.number,.totals td,.totals th+th{text-align:right;font-variant-numeric:tabular-nums}
th[tabindex]{cursor:pointer}
th[aria-sort=ascending]::after{content:" \\25b2"}th[aria-sort=descending]::after{content:" \\25bc"}
img{display:block;width:120px;height:90px;background:#fff}.failed{color:var(--bad)}.waiting,.running{color:var(--soft)}
.outlier{background:var(--mark)}figure{margin:1em 0}.cohort{display:flex;flex-wrap:wrap;gap:3em;align-items:end}
h2{margin:.5em 0 0;font-size:1.1em}ul{margin:.3em 0;padding-left:1.2em}rect{fill:var(--bar)}
text{fill:var(--soft);font-size:12px}
figcaption,#shown{color:var(--soft)}
"""
SCRIPT = """
'use strict';
const table = document.getElementById('cases'), body = table.tBodies[0], rows = [...body.rows];
const heads = [...table.tHead.rows[0].cells];
const search = document.getElementById('search'), filter = document.getElementById('filter');
const state = new URLSearchParams(location.hash.slice(1));
function key(row, at) {
  const cell = row.cells[at], text = cell.dataset.key ?? cell.textContent;
  if (!heads[at].classList.contains('number')) return text.toLowerCase();
  const number = parseFloat(text);
  return Number.isNaN(number) ? null : number;
}
function sort(at, down) {
  const order = rows.map((row, index) => [key(row, at), index, row]);
  order.sort(([a, i], [b, j]) => {
    const empty = value => value === null || value === '';
    if (empty(a) || empty(b)) return empty(a) - empty(b) || i - j;
    const side = typeof a === 'number' ? a - b : a.localeCompare(b, undefined, {numeric: true});
    return (down ? -side : side) || i - j;
  });
  body.append(...order.map(([, , row]) => row));
  heads.forEach(head => head.removeAttribute('aria-sort'));
  heads[at].setAttribute('aria-sort', down ? 'descending' : 'ascending');
}
function show() {
  const words = search.value.toLowerCase().split(/\\s+/).filter(Boolean);
  let shown = 0;
  for (const row of rows) {
    row.hidden = Boolean(filter.value) && !row.classList.contains(filter.value)
      || !words.every(word => row.dataset.text.includes(word));
    shown += !row.hidden;
  }
  document.getElementById('shown').textContent = `${shown} of ${rows.length}`;
}
function keep(name, value) {
  state.set(name, value);
  history.replaceState(null, '', '#' + state);  // a page that looks again stays as it was set
}
heads.forEach((head, at) => {
  if (!head.textContent) return;
  head.tabIndex = 0;
  head.onclick = () => {
    const down = head.getAttribute('aria-sort') === 'ascending';
    sort(at, down);
    keep('sort', at + (down ? '-' : '+'));
  };
  head.onkeydown = event => { if (event.key === 'Enter') head.onclick(); };
});
search.oninput = () => { show(); keep('search', search.value); };
filter.onchange = () => { show(); keep('filter', filter.value); };
search.value = state.get('search') ?? '';
filter.value = state.get('filter') ?? '';
if (filter.selectedIndex < 0) filter.value = '';
document.getElementById('controls').hidden = false;
const sorted = /^(\\d+)([+-])$/.exec(state.get('sort') ?? '');
if (sorted && heads[sorted[1]]) sort(Number(sorted[1]), sorted[2] === '-');
show();
"""
