'use strict';
(function () {
  const targets = Array.from(document.querySelectorAll('.plot'));
  const touch = window.matchMedia('(pointer: coarse)').matches;
  const page = { total: targets.length, drawn: 0, failed: [] };
  window.smaPage = page;

  function curve(packed) { // 16-bit steps above the lowest value; 65535 is a gap
    const bytes = Uint8Array.from(atob(packed.steps), function (letter) { return letter.charCodeAt(0); });
    const view = new DataView(bytes.buffer);
    return Float64Array.from({ length: bytes.length / 2 }, function (_, k) {
      const step = view.getUint16(2 * k, true);
      return step === 65535 ? NaN : packed.low + packed.step * step;
    });
  }

  function unpack(figure) {
    const curves = figure.packed.map(curve);
    for (const trace of figure.data) {
      for (const [name, value] of Object.entries(trace)) {
        if (value !== null && typeof value === 'object' && 'packed' in value) trace[name] = curves[value.packed];
      }
    }
    return figure;
  }

  function draw(target) {
    if (target.dataset.state) return;
    target.dataset.state = 'drawing';
    const data = document.getElementById(target.id.replace('plot', 'data'));
    const figure = unpack(JSON.parse(data.textContent));
    data.remove();
    figure.layout.height = target.clientHeight;
    figure.layout.autosize = true;
    if (touch) figure.layout.dragmode = false; // a finger scrolls the page; buttons zoom
    const small = target.closest('.grid') !== null; // no room for buttons
    const config = { responsive: true, displaylogo: false, displayModeBar: small ? false : undefined,
      modeBarButtonsToRemove: ['select2d', 'lasso2d', 'autoScale2d'] };
    Plotly.newPlot(target, figure.data, figure.layout, config).then(function () {
      target.dataset.state = 'drawn';
      page.drawn += 1;
    }).catch(function (error) {
      page.failed.push(target.id);
      console.error(target.id, error);
    });
  }

  const watch = new IntersectionObserver(function (entries) {
    for (const entry of entries) {
      if (entry.isIntersecting) { watch.unobserve(entry.target); draw(entry.target); }
    }
  }, { rootMargin: '600px' });
  targets.forEach(function (target) { watch.observe(target); });

  const header = document.querySelector('header'); // what is jumped to has to stand below it
  new ResizeObserver(function () { document.documentElement.style.setProperty('--header', `${header.offsetHeight}px`); }).observe(header);

  for (const tabs of document.querySelectorAll('.tabs')) {
    const buttons = Array.from(tabs.querySelector('.buttons').children);
    const panes = Array.from(tabs.children).filter(function (item) { return item.classList.contains('pane'); });
    buttons.forEach(function (button, chosen) {
      button.addEventListener('click', function () {
        buttons.forEach(function (item, k) { item.setAttribute('aria-selected', String(k === chosen)); });
        panes.forEach(function (item, k) { item.hidden = k !== chosen; });
        panes[chosen].querySelectorAll('.js-plotly-plot').forEach(function (plot) { Plotly.Plots.resize(plot); });
      });
    });
  }
  window.addEventListener('beforeprint', function () { targets.forEach(draw); });
})();
