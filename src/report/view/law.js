
// The law of a fit: parameters are dragged, everything else follows by stored sensitivities.
(() => {
const data = JSON.parse(document.getElementById('data').textContent), fit = data.fit, at = id => document.getElementById(id);
if (!fit) return;
const SVG = at('curve').namespaceURI, COLOURS = ['#0072b2', '#d55e00'];
const short = v => Number.isFinite(v) ? String(+v.toPrecision(4)) : 'not known';
const element = (name, text) => { const made = document.createElement(name); if (text !== undefined) made.textContent = text; return made; };
at('law').hidden = false;
// A report has said the verdict already, and has the budget as well.
const verdict = at('verdict');
if (verdict) for (const [k, text] of fit.sentences.entries()) { const made = element('p', text); made.className = k ? '' : `lead${fit.determined ? '' : ' warn'}`; at('law-verdict').append(made); }
// The verdict first, before all fields.
if (verdict && fit.sentences.length) { const made = element('p', fit.sentences[0]); made.className = `lead${fit.determined ? '' : ' warn'}`; verdict.prepend(made); }
const parameters = fit.parameters, offset = parameters.map(() => 0);
let instant = Math.max(0, fit.joint.length - 1);

/** Value and ends of an axis with some room. */
function ends(lists) {
  let low = 0, high = 0;
  for (const list of lists) for (const v of list) if (Number.isFinite(v)) { low = Math.min(low, v); high = Math.max(high, v); }
  if (!(high > low)) high = low + 1;
  return [low - .04 * (high - low), high + .06 * (high - low)];
}
/** A plot of curves {x, y, base, low, high}: the band, the fit (dashed) and what is dragged. */
function plot(title, xLabel, yLabel, curves) {
  const w = 420, h = 270, m = { l: 62, r: 10, t: 26, b: 42 }, svg = document.createElementNS(SVG, 'svg');
  svg.setAttribute('viewBox', `0 0 ${w} ${h}`);
  svg.setAttribute('role', 'img');
  svg.setAttribute('aria-label', title);
  const add = (name, attributes, text) => { const made = document.createElementNS(SVG, name); for (const key in attributes) made.setAttribute(key, attributes[key]); if (text !== undefined) made.textContent = text; svg.append(made); return made; };
  const [x0, x1] = ends(curves.map(c => c.x)), all = ends(curves.flatMap(c => [c.base, c.low || [], c.high || []])), moved = ends(curves.map(c => c.y));
  // A parameter that is dragged far may leave the picture: at most half of it again is added.
  const span = all[1] - all[0], y0 = Math.max(all[0] - .5 * span, Math.min(all[0], moved[0])), y1 = Math.min(all[1] + .5 * span, Math.max(all[1], moved[1]));
  const X = v => m.l + (v - x0) / (x1 - x0) * (w - m.l - m.r), Y = v => h - m.b - (v - y0) / (y1 - y0) * (h - m.t - m.b);
  const letters = { 'font-size': 13, 'font-family': 'inherit', fill: '#1a1a1a' };
  const steps = (low, high) => { const raw = (high - low) / 4, base = 10 ** Math.floor(Math.log10(raw)), step = [1, 2, 5, 10].map(k => k * base).find(s => s >= raw), out = []; for (let v = Math.ceil(low / step - 1e-9) * step; v <= high; v += step) out.push(Math.abs(v) < 1e-9 * step ? 0 : v); return out; };
  for (const v of steps(x0, x1)) { add('line', { x1: X(v), x2: X(v), y1: m.t, y2: h - m.b, stroke: '#ddd' }); add('text', { ...letters, x: X(v), y: h - m.b + 16, 'text-anchor': 'middle' }, short(v)); }
  for (const v of steps(y0, y1)) { add('line', { x1: m.l, x2: w - m.r, y1: Y(v), y2: Y(v), stroke: '#ddd' }); add('text', { ...letters, x: m.l - 5, y: Y(v) + 4, 'text-anchor': 'end' }, short(v)); }
  add('rect', { x: m.l, y: m.t, width: w - m.l - m.r, height: h - m.t - m.b, fill: 'none', stroke: '#333' });
  add('text', { ...letters, x: (m.l + w - m.r) / 2, y: h - 6, 'text-anchor': 'middle' }, xLabel);
  // Names stand behind the title, where no curve comes: with them the unit alone is left of what it counts.
  const head = add('text', { ...letters, x: 4, y: 16 }, `${title}: ${curves[0].name ? '' : yLabel}`);
  const word = (text, colour) => { const made = document.createElementNS(SVG, 'tspan'); made.textContent = text; made.setAttribute('fill', colour); head.append(made); };
  if (curves[0].name) { curves.forEach((c, k) => { word(`${k ? ', ' : ''}`, '#1a1a1a'); word(c.name, COLOURS[k % 2]); }); word(` ${yLabel}`, '#1a1a1a'); }
  const inside = v => Math.max(m.t, Math.min(h - m.b, v));
  curves.forEach((c, k) => {
    const colour = COLOURS[k % 2], line = list => { let d = '', on = false; c.x.forEach((x, i) => { if (Number.isFinite(x) && Number.isFinite(list[i])) { d += `${on ? 'L' : 'M'}${X(x).toFixed(1)} ${inside(Y(list[i])).toFixed(1)}`; on = true; } else on = false; }); return d; };
    if (c.low && c.high) {
      const good = c.x.map((v, i) => i).filter(i => Number.isFinite(c.low[i]) && Number.isFinite(c.high[i]) && c.low[i] !== null && c.high[i] !== null);
      const points = [...good.map(i => [c.x[i], c.high[i]]), ...good.reverse().map(i => [c.x[i], c.low[i]])];
      if (points.length) add('polygon', { points: points.map(([x, y]) => `${X(x).toFixed(1)},${inside(Y(y)).toFixed(1)}`).join(' '), fill: colour, opacity: .2 });
    }
    add('path', { d: line(c.base), fill: 'none', stroke: colour, 'stroke-width': 1.2, 'stroke-dasharray': '5 4' });
    add('path', { d: line(c.y), fill: 'none', stroke: colour, 'stroke-width': 2.2 });
  });
  return svg;
}
const moved = (base, by) => base.map((v, i) => v === null ? NaN : v + offset.reduce((s, d, k) => s + (d ? d * by[k][i] : 0), 0));
const numbers = list => list.map(v => v === null ? NaN : v);
function draw() {
  const charts = [];
  fit.modes.forEach((mode, k) => {
    const base = numbers(mode.value), y = mode.by ? moved(mode.value, mode.by) : base;
    charts.push(plot(['Opening', 'Sliding'][k], ['opening (mm)', 'sliding (mm)'][k], 'traction (MPa)', [{ x: numbers(mode.jump_mm), y, base, low: mode.low, high: mode.high }]));
  });
  const joint = fit.joint[instant];
  if (joint) {
    const of = q => ({ x: numbers(joint.along_mm), base: numbers(joint.value[q]), y: moved(joint.value[q], joint.by.map(by => by[q])) });
    const band = c => joint.ends ? joint.ends[c] : {};
    charts.push(plot('Tractions', 'distance along the joint (mm)', '(MPa)', [{ ...of(2), ...band(0), name: 'T_n' }, { ...of(3), ...band(1), name: 'T_t' }]));
    charts.push(plot('Jumps', 'distance along the joint (mm)', '(mm)', [{ ...of(0), name: 'opening' }, { ...of(1), name: 'sliding' }]));
  }
  at('law-charts').replaceChildren(...charts);
  const test = fit.misfit ? `chi-square of the fit ${short(fit.misfit.omega)}, expected ${short(fit.misfit.freedom)} (z ${short(fit.misfit.z)}, limit ${short(fit.misfit.z_limit)})` : `objective of the fit ${short(fit.omega)}`;
  if (!fit.inverse) { at('law-distance').textContent = `${test}; without uncertainties no distance from it is known.`; return; }
  const away = offset.reduce((s, a, i) => s + offset.reduce((t, b, j) => t + a * fit.inverse[i][j] * b, 0), 0), inside = away <= fit.limit;
  at('law-distance').textContent = `${test}. Here chi-square is higher by ${short(away)}: ${inside ? 'inside' : 'outside of'} the 95 % region of ${parameters.length === 1 ? 'the parameter' : `the ${parameters.length} parameters together`} (below ${short(fit.limit)}).`;
  at('law-distance').className = inside ? '' : 'lead warn';
}
parameters.forEach((p, k) => {
  const label = element('label', p.name), slider = element('input'), said = element('output'), row = element('div');
  // Three standard uncertainties, and no further than a third of the value: first order holds nearby.
  const most = Math.min(p.std ? 3 * p.std : .3 * Math.abs(p.value), .34 * Math.abs(p.value)) || 1;
  Object.assign(slider, { type: 'range', min: -1, max: 1, step: .01, value: 0, id: `law-${k}` });
  label.htmlFor = slider.id;
  label.title = p.meaning;
  const tell = () => { said.textContent = `${short(p.value + offset[k])} ${p.unit === '1' ? '' : p.unit} (${short(p.value)} \u00b1 ${short(p.std === null ? NaN : p.std)})`; };
  slider.addEventListener('input', () => { offset[k] = most * slider.value; tell(); draw(); });
  row.className = 'slider';
  row.append(label, slider, said);
  at('law-sliders').append(row);
  tell();
});
at('law-back').addEventListener('click', () => { parameters.forEach((p, k) => { offset[k] = 0; at(`law-${k}`).value = 0; at(`law-${k}`).dispatchEvent(new Event('input')); }); });
fit.joint.forEach((joint, k) => { const made = element('option', joint.instant); made.value = k; at('instant').append(made); });
at('instant').value = String(instant);
at('instant-label').hidden = !fit.joint.length;
at('instant').addEventListener('change', event => { instant = +event.target.value; draw(); });

/** Of each parameter its budget as bars, the largest first. */
for (const p of parameters) {
  const parts = fit.budget.map(line => ({ name: line.name, included: line.included, percent: 100 * Math.abs((line.parameters[p.name] || 0) / p.value) })).filter(part => part.percent > 0).sort((a, b) => b.percent - a.percent).slice(0, 8);
  const w = 420, row = 24, h = 30 + row * parts.length, most = Math.max(...parts.map(part => part.percent), 1e-12), svg = document.createElementNS(SVG, 'svg');
  svg.setAttribute('viewBox', `0 0 ${w} ${h}`);
  svg.setAttribute('role', 'img');
  svg.setAttribute('aria-label', `error budget of ${p.name}`);
  const add = (name, attributes, text) => { const made = document.createElementNS(SVG, name); for (const key in attributes) made.setAttribute(key, attributes[key]); if (text !== undefined) made.textContent = text; svg.append(made); };
  const letters = { 'font-size': 13, 'font-family': 'inherit', fill: '#1a1a1a' };
  add('text', { ...letters, x: 2, y: 16, 'font-weight': 'bold' }, p.name);
  parts.forEach((part, k) => {
    const y = 26 + row * k, length = 210 * part.percent / most;
    add('text', { ...letters, x: 2, y: y + 14 }, part.name);
    add('rect', { x: 130, y: y + 2, width: Math.max(1, length), height: row - 8, fill: part.included ? '#0072b2' : '#fff', stroke: '#0072b2', 'stroke-dasharray': part.included ? 'none' : '3 2' });
    add('text', { ...letters, x: 136 + length, y: y + 14 }, `${short(part.percent)} %`);
  });
  at('budget').append(svg);
}
draw();
})();
