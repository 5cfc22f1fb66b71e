'use strict';
const batch = JSON.parse(document.getElementById('batch').textContent);
const state = new URLSearchParams(location.hash.slice(1));

// Texts go in as text, never as HTML, so nothing in a name or a note can run.
function element(tag, fields = {}, ...children) {
  const made = Object.assign(document.createElement(tag), fields);
  made.append(...children);
  return made;
}

function unfolded(title, ...children) {
  return element('details', {}, element('summary', {}, title), ...children);
}

function tableRow(tag, texts) {
  return element('tr', {}, ...texts.map(text => element(tag, {}, text)));
}

function list(texts) {
  return element('ul', {}, ...texts.map(text => element('li', {}, text)));
}

function totals(rows) {
  const heads = ['', 'cases', 'sum', 'median', 'least', 'most'];
  const lines = rows.map(([name, ...facts]) =>
    element('tr', {}, element('th', {}, name), ...facts.map(fact => element('td', {}, fact))));
  return element('table', { className: 'totals' }, tableRow('th', heads), ...lines);
}

function histogram({ start, width, heights, unit, cases }) {
  const most = Math.max(...heights), edge = at => String(Number((start + at * width).toPrecision(6)));
  const bars = element('div', { className: 'bars' });
  heights.forEach((count, at) => {
    const bar = element('div', { title: `${edge(at)} to ${edge(at + 1)} ${unit}: ${count}` });
    bar.style.height = `${100 * count / most}%`;
    bars.append(bar);
  });
  const ends = element('div', { className: 'ends' }, element('span', {}, edge(0)),
    element('span', {}, edge(heights.length)));
  const caption = `volumes of ${cases} cases, ${unit}; ${Number(width.toPrecision(6))} ${unit} a bar, the highest ${most}`;
  return element('figure', {}, bars, ends, element('figcaption', {}, caption));
}

function cohort({ label, totals: rows, histogram: bins }) {
  const shown = element('div', { className: 'cohort' }, totals(rows), ...(bins ? [histogram(bins)] : []));
  return label === null ? [shown] : [element('h2', {}, `label ${label}`), shown];
}

function picture(row) {
  const fields = { alt: '', loading: 'lazy', width: 120, height: 90, src: row.picture };
  return row.picture ? [element('img', fields)] : [];
}

function caseCell(row) {
  const parts = [row.page ? element('a', { href: row.page }, row.case) : row.case];
  if (row.surfaces) {
    const lines = row.surfaces.map(surface => tableRow('td', [surface.name, ...surface.texts]));
    const table = element('table', {}, tableRow('th', ['label', ...batch.surface_heads]), ...lines);
    parts.push(unfolded(`${lines.length} surfaces`, table));
  }
  return parts;
}

function notesCell(row) {
  const notes = row.notes ? row.notes.split(batch.notes_between) : [];
  return notes.length ? [unfolded(`${notes.length} note${notes.length === 1 ? '' : 's'}`, list(notes))] : [];
}

function largest(numbers) {
  const known = numbers.filter(number => typeof number === 'number');
  return known.length ? Math.max(...known) : null;
}

function spacing(row) {
  return [row.spacing_x_mm, row.spacing_y_mm, row.spacing_z_mm].filter(side => side !== null);
}

function digits(number, places) {
  return number === null ? '' : number.toFixed(places);
}

// Every column: its head, what stands in a cell, and the key by which it is sorted; a number has the class of its cells.
const columns = [
  { head: '', content: picture },
  { head: 'case', content: caseCell, key: row => row.case },
  { head: 'status', content: row => [row.status], key: row => row.status },
  ...batch.measures.map(({ head, columns: names, number }, at) => ({
    head,
    number,
    content: row => [row.texts[at]],
    key: row => number ? largest(names.map(name => row[name])) : row.texts[at],
  })),
  {
    head: 'spacing, mm',
    number: true,
    content: row => [spacing(row).map(side => String(Number(side.toPrecision(3)))).join(' ')],
    key: row => largest(spacing(row)),
  },
  { head: 'seconds', number: true, content: row => [digits(row.seconds, 1)], key: row => row.seconds },
  {
    head: 'memory, MiB',
    number: true,
    content: row => [row.memory_bytes === null ? '' : digits(row.memory_bytes / 2 ** 20, 0)],
    key: row => row.memory_bytes,
  },
  { head: 'look at', content: row => [row.outlier], key: row => row.outlier },
  { head: 'notes', content: notesCell, key: row => row.notes },
  { head: 'error', content: row => [row.error ?? ''], key: row => row.error ?? '' },
];

const listed = batch.rows.filter(row => row.status !== 'absent');
const absent = batch.rows.filter(row => row.status === 'absent');
const lines = listed.map(row => ({
  row,
  text: [row.case, row.status, row.notes, row.outlier, row.error ?? ''].join(' ').toLowerCase(),
  element: element('tr', { className: row.outlier ? `${row.status} outlier` : row.status },
    ...columns.map(({ content, number }) => element('td', number ? { className: 'number' } : {}, ...content(row)))),
}));
const heads = columns.map(({ head, number }) => element('th', number ? { className: 'number' } : {}, head));
const body = element('tbody', {}, ...lines.map(line => line.element));
const states = [...new Set(listed.map(row => row.status)), ...(listed.some(row => row.outlier) ? ['outlier'] : [])];
const search = element('input', { id: 'search', type: 'search', placeholder: 'search', ariaLabel: 'search' });
const filter = element('select', { id: 'filter', ariaLabel: 'show' }, element('option', { value: '' }, 'all'),
  ...states.map(name => element('option', {}, name)));
const shown = element('span', { id: 'shown' });

function sort(at, down) {
  const empty = value => value === null || value === '';
  const order = lines.map((line, index) => [columns[at].key(line.row), index, line.element]);
  order.sort(([a, i], [b, j]) => {
    if (empty(a) || empty(b)) return empty(a) - empty(b) || i - j;
    const side = typeof a === 'number' ? a - b
      : a.toLowerCase().localeCompare(b.toLowerCase(), undefined, { numeric: true });
    return (down ? -side : side) || i - j;
  });
  body.append(...order.map(([, , line]) => line));
  heads.forEach(head => head.removeAttribute('aria-sort'));
  heads[at].setAttribute('aria-sort', down ? 'descending' : 'ascending');
}

function show() {
  const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
  for (const { row, text, element: line } of lines) {
    const fits = !filter.value || row.status === filter.value || filter.value === 'outlier' && Boolean(row.outlier);
    line.hidden = !fits || !words.every(word => text.includes(word));
  }
  shown.textContent = `${lines.filter(line => !line.element.hidden).length} of ${lines.length}`;
}

function keep(name, value) {
  state.set(name, value);
  history.replaceState(null, '', '#' + state);  // A page that reloads itself stays sorted and filtered.
}

heads.forEach((head, at) => {
  if (!columns[at].key) return;
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

document.body.append(
  element('h1', {}, batch.title), element('p', {}, `ctmc ${batch.version}`), ...batch.cohorts.flatMap(cohort),
  element('p', { id: 'controls' }, search, ' ', filter, ' ', shown),
  element('table', { id: 'cases' }, element('thead', {}, element('tr', {}, ...heads)), body));
if (absent.length) {
  const names = list(absent.map(row => `${row.case}: ${row.error ?? ''}`));
  document.body.append(Object.assign(unfolded(`${absent.length} absent: without the label`, names), { id: 'absent' }));
}
search.value = state.get('search') ?? '';
filter.value = state.get('filter') ?? '';
if (filter.selectedIndex < 0) filter.value = '';
const sorted = /^(\d+)([+-])$/.exec(state.get('sort') ?? '');
if (sorted && columns[sorted[1]]?.key) sort(Number(sorted[1]), sorted[2] === '-');
show();
