// What the pages of fields and of a studio share: numbers, curves, and what is taken away from them.
/** A number with as many digits as `step` is worth. */
function written(v, step) {
  if (!Number.isFinite(v)) return 'none';
  if (!(step > 0)) return String(+v.toPrecision(6));
  const digits = Math.max(0, Math.min(9, 1 - Math.floor(Math.log10(step))));
  return Math.abs(v) >= 1e7 || (v !== 0 && Math.abs(v) < 1e-6) ? v.toExponential(3) : v.toFixed(digits);
}
const CURVE_COLOURS = ['#0072b2', '#d55e00', '#009e73', '#7a4fa3'];
/** Round numbers from `low` to `high`, about `n` of them, and their distance. */
function ticks(low, high, n) {
  const raw = (high - low) / n, base = 10 ** Math.floor(Math.log10(raw)), step = [1, 2, 5, 10].map(k => k * base).find(s => s >= raw), out = [];
  for (let v = Math.ceil(low / step - 1e-9) * step; v <= high + 1e-9 * step; v += step) out.push(Math.abs(v) < 1e-9 * step ? 0 : v);
  return [out, step];
}
/**
 * Curves {x, xLabel, yLabel, note, series: [{name, y, band}]} as a picture `w` wide; null where there is nothing to draw. `here` is the place of a
 * point to be seen, `cut` says of each whether an edge cuts its window.
 */
function chartOf(plot, w) {
  const h = Math.round(Math.min(360, .55 * w + 60)), finite = list => list.filter(Number.isFinite), several = plot.series.length > 1;
  const xs = finite(plot.x), ys = finite(plot.series.flatMap(s => s.band ? [...s.y.map((v, k) => v - s.band[k]), ...s.y.map((v, k) => v + s.band[k]), ...s.y] : s.y));
  if (!xs.length || !ys.length) return null;
  const svg = document.createElementNS(document.getElementById('curve').namespaceURI, 'svg');
  for (const [key, value] of Object.entries({ viewBox: `0 0 ${w} ${h}`, role: 'img', 'aria-label': plot.note, 'font-size': 13, 'font-family': getComputedStyle(document.body).fontFamily })) svg.setAttribute(key, value);
  const add = (name, attributes, text) => {
    const made = document.createElementNS(svg.namespaceURI, name);
    for (const key in attributes) made.setAttribute(key, attributes[key]);
    if (text !== undefined) made.textContent = text;
    svg.append(made);
    return made;
  };
  const ends = (list, room) => {
    let low = Math.min(...list), high = Math.max(...list);
    if (!(high > low)) { const half = Math.abs(low) * .1 || 1; low -= half; high += half; }
    return [low - room * (high - low), high + room * (high - low)];
  };
  const [x0, x1] = ends(xs, 0), [y0, y1] = ends(ys, .05), [yt, ystep] = ticks(y0, y1, 5), yWords = yt.map(v => written(v, ystep * 9));
  const [xt, xstep] = ticks(x0, x1, w < 500 ? 3 : 5), xWords = xt.map(v => written(v, xstep * 9)), longest = words => Math.max(0, ...words.map(word => word.length));
  // Digits of 13 px are at most 8.5 px wide; half of a number stands beyond the end of its axis.
  const m = { l: 12 + 8.5 * longest(yWords), r: 6 + 4.25 * longest(xWords), t: 26, b: 44 };
  const X = v => m.l + (v - x0) / (x1 - x0) * (w - m.l - m.r), Y = v => h - m.b - (v - y0) / (y1 - y0) * (h - m.t - m.b);
  const fill = '#1a1a1a';
  if (plot.cut) {
    const half = (x1 - x0) / (plot.x.length - 1) / 2;
    plot.x.forEach((v, k) => { if (plot.cut[k]) add('rect', { x: X(Math.max(x0, v - half)), y: m.t, width: X(Math.min(x1, v + half)) - X(Math.max(x0, v - half)), height: h - m.t - m.b, fill: '#e6e6e6', class: 'cut' }); });
  }
  xt.forEach((v, k) => { add('line', { x1: X(v), x2: X(v), y1: m.t, y2: h - m.b, stroke: '#ddd' }); add('text', { x: X(v), y: h - m.b + 16, 'text-anchor': 'middle', fill }, xWords[k]); });
  yt.forEach((v, k) => { add('line', { x1: m.l, x2: w - m.r, y1: Y(v), y2: Y(v), stroke: '#ddd' }); add('text', { x: m.l - 5, y: Y(v) + 4, 'text-anchor': 'end', fill }, yWords[k]); });
  add('rect', { x: m.l, y: m.t, width: w - m.l - m.r, height: h - m.t - m.b, fill: 'none', stroke: '#333' });
  add('text', { x: (m.l + w - m.r) / 2, y: h - 8, 'text-anchor': 'middle', fill }, plot.xLabel);
  add('text', { x: 4, y: 16, fill }, plot.yLabel);
  plot.series.forEach((s, k) => {
    const colour = CURVE_COLOURS[k % CURVE_COLOURS.length];
    if (s.band) {
      const good = plot.x.map((v, i) => i).filter(i => Number.isFinite(plot.x[i]) && Number.isFinite(s.y[i]) && Number.isFinite(s.band[i]));
      const path = [...good.map(i => [plot.x[i], s.y[i] + s.band[i]]), ...good.reverse().map(i => [plot.x[i], s.y[i] - s.band[i]])];
      if (path.length) add('polygon', { points: path.map(([x, y]) => `${X(x).toFixed(1)},${Y(y).toFixed(1)}`).join(' '), fill: colour, opacity: .2 });
    }
    let d = '', on = false;
    plot.x.forEach((v, i) => {
      if (Number.isFinite(v) && Number.isFinite(s.y[i])) { d += `${on ? 'L' : 'M'}${X(v).toFixed(1)} ${Y(s.y[i]).toFixed(1)}`; on = true; } else on = false;
    });
    add('path', { d, fill: 'none', stroke: colour, 'stroke-width': 2, 'stroke-dasharray': k ? '6 3' : 'none' });
    if (plot.here !== undefined && Number.isFinite(s.y[plot.here]) && Number.isFinite(plot.x[plot.here])) add('circle', { cx: X(plot.x[plot.here]), cy: Y(s.y[plot.here]), r: 4, fill: colour });
    if (several) add('text', { x: m.l + 8, y: m.t + 16 + 16 * k, fill: colour, stroke: '#fff', 'stroke-width': 3, 'paint-order': 'stroke' }, s.name.length > 40 ? `${s.name.slice(0, 39)}\u2026` : s.name);
  });
  return svg;
}
function download(name, href) {
  const link = document.createElement('a');
  link.download = name;
  link.href = href;
  link.click();
}
/** Saves the numbers of curves. */
function saveTable(plot, name) {
  const quoted = text => `"${text.replaceAll('"', '""')}"`;
  const head = [plot.xLabel, ...plot.series.flatMap(s => s.band ? [s.name, `${s.name}, 95 % half width`] : [s.name])].map(quoted);
  const rows = plot.x.map((x, k) => [x, ...plot.series.flatMap(s => s.band ? [s.y[k], s.band[k]] : [s.y[k]])].join(','));
  download(`${name}.csv`, `data:text/csv;charset=utf-8,${encodeURIComponent([`# ${plot.note.replaceAll('\n', ' ')}`, `# ${plot.yLabel}`, head.join(','), ...rows].join('\n') + '\n')}`);
}
/** Saves a picture of curves, three pixels for each of the screen, for print. */
function savePicture(svg, name) {
  const [, , w, h] = svg.getAttribute('viewBox').split(' ').map(Number), copy = svg.cloneNode(true), image = new Image(), canvas = document.createElement('canvas');
  Object.assign(canvas, { width: 3 * w, height: 3 * h });
  copy.setAttribute('width', canvas.width);
  copy.setAttribute('height', canvas.height);
  image.onload = () => {
    const pen = canvas.getContext('2d');
    pen.fillStyle = '#fff';
    pen.fillRect(0, 0, canvas.width, canvas.height);
    pen.drawImage(image, 0, 0);
    download(`${name}.png`, canvas.toDataURL('image/png'));
  };
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(new XMLSerializer().serializeToString(copy))}`;
}
/** Puts the text of `node` onto the clipboard, or marks it where the browser does not let one; gives what to say of it. */
async function copied(node) {
  try { await navigator.clipboard.writeText(node.textContent); return 'Copied.'; } catch {
    const range = document.createRange();
    range.selectNodeContents(node);
    getSelection().removeAllRanges();
    getSelection().addRange(range);
    return 'Marked: copy it with the keys of your system.';
  }
}
