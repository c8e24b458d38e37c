// Reads out and enlarges figures; the page is whole without it. A mouse over a figure shows the values there, dragging a rectangle enlarges it, a double
// click shows all again. Each drawing says where its panels lie and what they range over: left top width height, then low and high of both axes, then
// whether they are logarithmic.
(() => {
  const ns = 'http://www.w3.org/2000/svg';
  const short = (x) => {
    const size = Math.abs(x);
    return (size !== 0 && (size < 1e-3 || size >= 1e5) ? x.toExponential(3) : String(+x.toPrecision(4))).replace('-', '−');
  };
  for (const svg of document.querySelectorAll('figure svg[data-panels]')) {
    const whole = svg.getAttribute('viewBox');
    const panels = svg.dataset.panels.split(';').map((p) => p.split(' ').map(Number));
    const told = document.createElement('p');
    told.className = `told ${['wide', 'narrow'].find((c) => svg.classList.contains(c)) ?? ''}`;
    told.textContent = '\u00a0';
    svg.after(told);
    const at = (event) => {
      const m = svg.getScreenCTM();
      return m ? new DOMPoint(event.clientX, event.clientY).matrixTransform(m.inverse()) : { x: -1, y: -1 };
    };
    const value = (low, high, log, share) => {
      const v = low + (high - low) * share;
      return log ? 10 ** v : v;
    };
    let from = null;
    let box = null;
    const drop = () => {
      if (box) box.remove();
      from = box = null;
    };
    svg.addEventListener('pointermove', (event) => {
      const p = at(event);
      const panel = panels.find(([l, t, w, h]) => p.x >= l && p.x <= l + w && p.y >= t && p.y <= t + h);
      if (panel) {
        const [l, t, w, h, x0, x1, y0, y1, xlog, ylog] = panel;
        const x = value(x0, x1, xlog, (p.x - l) / w);
        const y = value(y0, y1, ylog, 1 - (p.y - t) / h);
        told.textContent = `across ${short(x)} · up ${short(y)}`;
      }
      if (box) {
        box.setAttribute('x', Math.min(from.x, p.x));
        box.setAttribute('y', Math.min(from.y, p.y));
        box.setAttribute('width', Math.abs(p.x - from.x));
        box.setAttribute('height', Math.abs(p.y - from.y));
      }
    });
    svg.addEventListener('pointerdown', (event) => {
      // A finger scrolls the page.
      if (event.pointerType === 'touch' || event.button !== 0) return;
      from = at(event);
      box = svg.appendChild(document.createElementNS(ns, 'rect'));
      box.setAttribute('class', 'zoom');
      if (event.isTrusted) svg.setPointerCapture(event.pointerId);
      event.preventDefault();
    });
    svg.addEventListener('pointerup', (event) => {
      if (!box) return;
      const p = at(event);
      const [width, height] = [Math.abs(p.x - from.x), Math.abs(p.y - from.y)];
      if (width > 12 && height > 12) {
        svg.setAttribute('viewBox', [Math.min(from.x, p.x), Math.min(from.y, p.y), width, height].join(' '));
        svg.classList.add('zoomed');
      }
      drop();
    });
    svg.addEventListener('pointercancel', drop);
    svg.addEventListener('pointerleave', () => { told.textContent = '\u00a0'; });
    svg.addEventListener('dblclick', () => {
      svg.setAttribute('viewBox', whole);
      svg.classList.remove('zoomed');
    });
  }
  // The drawing as a file, under the name of its numbers.
  for (const csv of document.querySelectorAll('figure a[download$=".csv"]')) {
    const link = document.createElement('a');
    link.textContent = 'SVG';
    link.href = '#';
    link.download = csv.download.replace(/csv$/, 'svg');
    link.addEventListener('click', () => {
      const drawing = csv.closest('figure').querySelector('svg').cloneNode(true);
      drawing.setAttribute('xmlns', ns);
      link.href = URL.createObjectURL(new Blob([new XMLSerializer().serializeToString(drawing)], { type: 'image/svg+xml' }));
    });
    csv.after(' · ', link);
  }
})();
