'use strict';
/**
 * A canvas that shows an image of `size` pixels, closer or farther, under mouse, pen and fingers. Points of the image are px, pixel
 * centres at whole numbers. `draw` is called when the view has changed; two fingers and the wheel change it, and a drag where
 * `moves()` says so; `on.down`, `on.move`, `on.up` get every other point (`on.move` also without a button, with `held` false).
 */
function imageView(canvas, size, { draw, moves, share, on }) {
  const view = { zoom: 1, middle: [size[0] / 2, size[1] / 2] };
  const at = id => document.getElementById(id);
  /** Pixels of the canvas for a pixel of the image. */
  view.factor = () => view.zoom * Math.min(canvas.width / size[0], canvas.height / size[1]);
  view.toCanvas = ([x, y]) => [(x + .5 - view.middle[0]) * view.factor() + canvas.width / 2, (y + .5 - view.middle[1]) * view.factor() + canvas.height / 2];
  view.toImage = ([x, y]) => [(x - canvas.width / 2) / view.factor() + view.middle[0] - .5, (y - canvas.height / 2) / view.factor() + view.middle[1] - .5];
  /** The image stays in sight. */
  const keep = () => {
    const half = [canvas.width / 2 / view.factor(), canvas.height / 2 / view.factor()];
    view.middle = view.middle.map((m, c) => half[c] * 2 >= size[c] ? size[c] / 2 : Math.max(half[c], Math.min(size[c] - half[c], m)));
  };
  view.closer = (by, about) => {
    const here = about || [canvas.width / 2, canvas.height / 2], p = view.toImage(here);
    view.zoom = Math.max(1, Math.min(60, view.zoom * by));
    const q = view.toImage(here);
    view.middle = [view.middle[0] + p[0] - q[0], view.middle[1] + p[1] - q[1]];
    keep();
    draw();
  };
  view.whole = () => { view.zoom = 1; keep(); draw(); };
  view.resize = () => {
    const ratio = window.devicePixelRatio || 1, width = canvas.parentElement.clientWidth, most = Math.max(240, share * window.innerHeight);
    const height = Math.min(most, width * size[1] / size[0]);
    canvas.style.height = `${height}px`;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    keep();
    draw();
  };
  /** Paints the image, or white where there is none. */
  view.paint = (pen, picture) => {
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.fillStyle = '#e8e8e8';
    pen.fillRect(0, 0, canvas.width, canvas.height);
    const [left, top] = view.toCanvas([-.5, -.5]), s = view.factor();
    pen.imageSmoothingEnabled = s < 3;
    if (picture.complete && picture.naturalWidth) pen.drawImage(picture, left, top, size[0] * s, size[1] * s);
    else { pen.fillStyle = '#fff'; pen.fillRect(left, top, size[0] * s, size[1] * s); }
  };
  const down = new Map();
  let pinch = null, dragged = false;
  const pointOf = event => {
    const box = canvas.getBoundingClientRect();
    return [(event.clientX - box.left) * canvas.width / box.width, (event.clientY - box.top) * canvas.height / box.height];
  };
  canvas.addEventListener('pointerdown', event => {
    down.set(event.pointerId, pointOf(event));
    if (event.isTrusted) canvas.setPointerCapture(event.pointerId);
    canvas.focus({ preventScroll: true });
    if (down.size === 2) { pinch = [...down.values()]; dragged = false; return; }
    dragged = true;
    if (!moves()) on.down(view.toImage(pointOf(event)), event);
  });
  canvas.addEventListener('pointermove', event => {
    const here = pointOf(event), before = down.get(event.pointerId);
    if (before) {
      down.set(event.pointerId, here);
      if (down.size === 2 && pinch) {
        const gap = ([a, b]) => Math.hypot(a[0] - b[0], a[1] - b[1]), now = [...down.values()];
        if (gap(pinch) > 0) view.closer(gap(now) / gap(pinch), [(now[0][0] + now[1][0]) / 2, (now[0][1] + now[1][1]) / 2]);
        pinch = now;
        return;
      }
      if (moves()) {
        view.middle = [view.middle[0] - (here[0] - before[0]) / view.factor(), view.middle[1] - (here[1] - before[1]) / view.factor()];
        keep();
        draw();
        return;
      }
    }
    on.move(view.toImage(here), event, Boolean(before) && dragged);
  });
  const up = event => {
    const was = down.delete(event.pointerId);
    if (down.size < 2) pinch = null;
    if (event.type === 'pointerup' && was && dragged && !moves()) on.up(view.toImage(pointOf(event)), event);
    dragged = false;
  };
  canvas.addEventListener('pointerup', up);
  canvas.addEventListener('pointercancel', up);
  canvas.addEventListener('wheel', event => {
    if (!(event.ctrlKey || event.shiftKey || moves() || view.zoom > 1)) return;
    event.preventDefault();
    view.closer(Math.exp(-event.deltaY / 400), pointOf(event));
  }, { passive: false });
  at('closer').addEventListener('click', () => view.closer(1.5));
  at('farther').addEventListener('click', () => view.closer(1 / 1.5));
  at('fit').addEventListener('click', view.whole);
  // A scroll bar that comes with a longer page makes the place narrower, too.
  let before = 0;
  new ResizeObserver(() => {
    const width = canvas.parentElement.clientWidth;
    if (width !== before) { before = width; view.resize(); }
  }).observe(canvas.parentElement);
  window.addEventListener('resize', view.resize);
  return view;
}
