/** What nobody can read of a page, a picture or a part of one: texts that lie on one another, or are cut off. */
const crowded = root => {
  const d = root.ownerDocument || root, top = root.documentElement || root, w = d.defaultView, faults = [], boxes = [];
  const silent = ['SCRIPT', 'STYLE', 'OPTION', 'NOSCRIPT', 'TITLE', 'DESC', 'METADATA'];
  const isShown = e => e.checkVisibility({ visibilityProperty: true });
  const take = (box, text, e) => {
    let { left, right, top: upper, bottom } = box;
    // What scrolls shows a part of it, what only cuts must show all; what sticks lies above others by intent.
    for (let p = e; p && p !== d.documentElement && p !== d.body; p = p.parentElement) {
      const { position, overflowX, overflowY } = w.getComputedStyle(p), c = p.getBoundingClientRect();
      if (position === 'sticky') return;
      if (overflowX === 'visible' && overflowY === 'visible') continue;
      if (!/auto|scroll/.test(overflowX) && (left < c.left - 1 || right > c.right + 1) || !/auto|scroll/.test(overflowY) && (upper < c.top - 1 || bottom > c.bottom + 1)) faults.push(`cut: ${text}`);
      [left, right, upper, bottom] = [Math.max(left, c.left), Math.min(right, c.right), Math.max(upper, c.top), Math.min(bottom, c.bottom)];
    }
    // A box has room for accents and the feet of letters, a fifth of it each, in which other letters may stand; that of an outline has none.
    const room = e.tagName === 'path' ? 0 : (bottom - upper) / 5;
    if (right - left > 1 && bottom > upper) boxes.push({ left, right, upper: upper + room, bottom: bottom - room, text });
  };
  const walk = d.createTreeWalker(top, NodeFilter.SHOW_TEXT), range = d.createRange();
  for (let node; (node = walk.nextNode());) {
    const e = node.parentElement;
    if (!node.data.trim() || silent.includes(e.tagName.toUpperCase()) || e.closest('text') || !isShown(e)) continue;
    range.selectNodeContents(node);
    for (const box of range.getClientRects()) take(box, node.data.trim().slice(0, 40), e);
  }
  for (const e of top.querySelectorAll('text, path[aria-label]')) {
    const text = e.textContent.trim() || e.getAttribute('aria-label');
    if (text && isShown(e)) take(e.getBoundingClientRect(), text.slice(0, 40), e);
  }
  if (top.tagName === 'svg') {
    const all = top.getBoundingClientRect();
    for (const { left, right, upper, bottom, text } of boxes) if (left < all.left - 1 || right > all.right + 1 || upper < all.top || bottom > all.bottom) faults.push(`beyond the picture: ${text}`);
  }
  const pen = document.createElement('canvas').getContext('2d');
  for (const e of top.querySelectorAll('input, select')) {
    if (!isShown(e)) continue;
    if (['text', 'number'].includes(e.type) && e.scrollWidth > e.clientWidth + 1) faults.push(`cut in ${e.id}: ${e.value}`);
    pen.font = w.getComputedStyle(e).font;
    // The arrow of a list is as wide as its letters are high, and there is a space on either side.
    if (e.tagName === 'SELECT' && e.selectedOptions.length && pen.measureText(e.selectedOptions[0].label).width > e.clientWidth - 20) faults.push(`cut in ${e.id}: ${e.selectedOptions[0].label}`);
  }
  boxes.sort((a, b) => a.upper - b.upper);
  boxes.forEach((a, k) => {
    for (let j = k + 1; j < boxes.length && boxes[j].upper < a.bottom - 1; j++) {
      const b = boxes[j];
      if (Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1 && Math.min(a.bottom, b.bottom) - b.upper > 1) faults.push(`'${a.text}' on '${b.text}'`);
    }
  });
  return faults;
};
/** The same of the drawn pictures in a page. */
const crowdedPictures = d => [...d.querySelectorAll('img, source')].flatMap(image => {
  const [head, text] = (image.getAttribute('srcset') || image.src).split(',');
  if (!head.startsWith('data:image/svg')) return [];
  const place = document.createElement('div');
  place.innerHTML = new TextDecoder().decode(Uint8Array.from(atob(text), c => c.charCodeAt(0)));
  document.body.append(place);
  const found = crowded(place.firstElementChild);
  place.remove();
  return found;
});
