'use strict';
// The numbers of curves under the pointer, the finger or the arrow keys: those that the page holds (data-series), none is computed.
for (const figure of document.querySelectorAll('figure[data-series]')) {
  const series = JSON.parse(figure.dataset.series), axes = JSON.parse(figure.dataset.axes);
  const over = figure.querySelector('.over'), line = figure.querySelector('.here'), said = figure.querySelector('output');
  const known = v => typeof v === 'number';
  const all = [...new Set(series.flatMap(one => one.x.filter((x, k) => known(x) && known(one.y[k]))))].sort((a, b) => a - b);
  const frame = () => matchMedia('(max-width: 640px)').matches ? axes.narrow : axes.wide;
  const [low, high] = axes.range || [0, 1], on = v => axes.log ? Math.log(v) : v;
  // Where an abscissa stands, as a share of the width of the picture.
  const share = x => { const [from, to] = frame(); return from + (to - from) * (on(x) - on(low)) / (on(high) - on(low)); };
  const shown = all.filter(x => x >= low && x <= high && Number.isFinite(on(x)));
  const text = v => String(Number(v.toPrecision(5)));
  let at = -1;
  const show = k => {
    at = k;
    line.hidden = k < 0;
    if (k < 0) { said.textContent = ''; return; }
    const x = shown[k], words = [];
    for (const one of series) {
      const n = one.x.indexOf(x);
      if (n < 0 || !known(one.y[n])) continue;
      const band = one.low && known(one.low[n]) && known(one.high[n]) && one.low[n] < one.high[n];
      words.push((one.name ? one.name + ' ' : '') + text(one.y[n]) + (band ? ` (${text(one.low[n])} to ${text(one.high[n])})` : ''));
    }
    line.style.left = 100 * share(x) + '%';
    said.textContent = `${axes.x}: ${text(x)}; ${axes.y}: ${words.join('; ')}`;
  };
  const nearest = event => {
    const box = over.getBoundingClientRect(), here = (event.clientX - box.left) / box.width;
    let best = -1;
    shown.forEach((x, k) => { if (best < 0 || Math.abs(share(x) - here) < Math.abs(share(shown[best]) - here)) best = k; });
    show(best);
  };
  over.addEventListener('pointermove', nearest);
  over.addEventListener('pointerdown', nearest);
  over.addEventListener('pointerleave', event => { if (event.pointerType === 'mouse') show(-1); });
  over.addEventListener('blur', () => show(-1));
  over.addEventListener('keydown', event => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!step || !shown.length) return;
    event.preventDefault();
    show(at < 0 ? (step > 0 ? 0 : shown.length - 1) : Math.min(shown.length - 1, Math.max(0, at + step)));
  });
}
