// Draws the charts of the page from the data in it: rates or lengths with their bounds against a bias or in time. No
// library, no request.
"use strict";
(() => {
  const NS = "http://www.w3.org/2000/svg";
  const COLOURS = 6, DASHES = ["", "7 3", "2 3", "8 3 2 3"], SHOWN_AT_FIRST = 4, FLOOR = 1e-16;
  const source = document.getElementById("chart-data");
  if (!source) return;

  const make = (parent, tag, attributes = {}, text = "") => {
    const node = document.createElementNS(NS, tag);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    if (text) node.textContent = text;
    parent.appendChild(node);
    return node;
  };
  const element = (parent, tag, attributes = {}, text = "") => {
    const node = document.createElement(tag);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    if (text) node.textContent = text;
    parent.appendChild(node);
    return node;
  };
  const digits = (value) => {
    if (value === 0) return "0";
    // The form of the tables: 1e-7, not 1.00e-7.
    return Math.abs(value) < 1e-3 || Math.abs(value) >= 1e6
      ? (+value.toPrecision(3)).toExponential().replace("e+", "e") : String(+value.toPrecision(3));
  };
  const share = (value) => `${digits(100 * value)} %`;
  const grouped = (value) => value.toLocaleString("en-GB");

  function valueText(row, quantity) {
    const {y, low, high, count, draws} = row;
    if (y === null) return "no value";
    if (!quantity.rate) return low === high ? `${digits(y)} m` : `${digits(y)} m (${quantity.bounds}: ${digits(low)} to ${digits(high)} m)`;
    const counted = count !== null && draws !== null ? `, ${grouped(count)} of ${grouped(draws)}` : "";
    if (low === null || high === null || low === high) return `${share(y)}${counted}`;
    if (y === 0) return `0 (below ${share(high)})${counted}`;
    if (y === 1) return `all (above ${share(low)})${counted}`;
    return `${share(y)} [${digits(100 * low)}, ${digits(100 * high)}]${counted}`;
  }

  function ticks(from, to, wanted) {
    const raw = (to - from) / wanted, size = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 2.5, 5, 10].map((m) => m * size).find((s) => s >= raw * 0.999);
    const out = [];
    for (let k = Math.ceil(from / step - 1e-9); k * step <= to + 1e-9 * step; k++) out.push(+(k * step).toPrecision(10));
    return out;
  }

  const SHAPES = [
    (s, x, y, r, a) => make(s, "circle", {cx: x, cy: y, r, ...a}),
    (s, x, y, r, a) => make(s, "rect", {x: x - r * .9, y: y - r * .9, width: 1.8 * r, height: 1.8 * r, ...a}),
    (s, x, y, r, a) => make(s, "path", {d: `M${x} ${y - 1.2 * r}l${1.15 * r} ${2 * r}h${-2.3 * r}z`, ...a}),
    (s, x, y, r, a) => make(s, "path", {d: `M${x} ${y - 1.3 * r}l${1.2 * r} ${1.3 * r}l${-1.2 * r} ${1.3 * r}l${-1.2 * r} ${-1.3 * r}z`, ...a}),
  ];

  function chart(data, place) {
    const state = {
      quantity: 0, log: data.log, menus: data.menus.map((one) => one.begin), at: null,
      shown: data.curves.map((_, k) => data.curves.length <= COLOURS || k < SHOWN_AT_FIRST),
    };
    const unit = (/\[(.*)\]/.exec(data.x) ?? ["", "m"])[1];
    // Lines and bands end where something is missing.
    const parts = (line) => line.reduce((made, row) => {
      const last = made.at(-1);
      if (!last.length || !(data.gap && row.x - last.at(-1).x > data.gap)) last.push(row);
      else made.push([row]);
      return made;
    }, [[]]);
    const controls = element(place, "div", {class: "controls"});
    const menu = (label, values, change) => {
      const box = element(controls, "label", {}, `${label} `);
      const select = element(box, "select");
      values.forEach((value, k) => element(select, "option", {value: k}, value));
      select.addEventListener("change", () => { change(+select.value); draw(); });
      return select;
    };
    if (data.quantities.length > 1) menu("show", data.quantities.map((q) => q.label), (k) => { state.quantity = k; });
    data.menus.forEach((one, k) => {
      menu(one.label, one.values, (value) => { state.menus[k] = value; }).value = one.begin;
    });
    const scale = menu("axis", ["linear", "logarithmic"], (k) => { state.log = k === 1; });
    scale.value = state.log ? 1 : 0;

    const canvas = element(place, "div", {class: "canvas"});
    const legend = element(place, "div", {class: "legend", role: "group", "aria-label": "curves, press to hide or show"});
    const buttons = data.curves.map((name, k) => {
      const button = element(legend, "button", {type: "button", "aria-pressed": state.shown[k]});
      const sample = make(button, "svg", {width: 30, height: 12, "aria-hidden": "true"});
      style(make(sample, "line", {x1: 0, y1: 6, x2: 30, y2: 6, "stroke-width": 2}), k);
      SHAPES[k % SHAPES.length](sample, 15, 6, 3.4, {class: `c${k % COLOURS} solid`});
      element(button, "span", {}, name);
      button.addEventListener("click", () => {
        state.shown[k] = !state.shown[k];
        button.setAttribute("aria-pressed", state.shown[k]);
        draw();
      });
      return button;
    });
    const tip = element(canvas, "div", {class: "tip", role: "status", "aria-live": "polite"});
    tip.hidden = true;

    function style(line, k) {
      line.setAttribute("class", `c${k % COLOURS}`);
      line.setAttribute("stroke-dasharray", DASHES[Math.floor(k / COLOURS + k) % DASHES.length]);
      return line;
    }

    function rows() {
      const first = 1 + data.menus.length, at = first + 2 + 4 * state.quantity;
      return data.rows
        .filter((row) => state.menus.every((chosen, k) => row[1 + k] === chosen || row[1 + k] === -1))
        .map((row) => ({
          curve: row[0], x: row[first], draws: row[first + 1],
          y: row[at], low: row[at + 1], high: row[at + 2], count: row[at + 3],
        }))
        .filter((row) => row.y !== null && row.x !== null)
        .sort((a, b) => a.x - b.x);
    }

    function draw() {
      canvas.querySelector("svg")?.remove();
      const quantity = data.quantities[state.quantity], all = rows();
      const width = Math.max(280, canvas.clientWidth || 640), height = Math.round(Math.min(340, Math.max(250, width * .45)));
      const box = {left: 58, right: width - 12, top: 28, bottom: height - 40};
      const words = `${quantity.label} against the ${data.x}, one curve for each of: ${data.curves.join("; ")}`;
      const svg = make(canvas, "svg", {
        viewBox: `0 0 ${width} ${height}`, width, height, tabindex: 0, role: "img",
        "aria-label": `Chart: ${words}. Left and right arrow keys read its values.`,
      });
      canvas.insertBefore(svg, tip);
      const visible = all.filter((row) => state.shown[row.curve]);
      const xs = [...new Set(all.map((row) => row.x))];
      if (!xs.length) { make(svg, "text", {x: width / 2, y: height / 2, "text-anchor": "middle"}, "no values here"); return; }
      const reach = [xs[0], xs[xs.length - 1]];
      if (reach[0] === reach[1]) { reach[0] -= 1; reach[1] += 1; }
      const gap = 0.02 * (reach[1] - reach[0]);
      const px = (x) => box.left + (x - reach[0] + gap) / (reach[1] - reach[0] + 2 * gap) * (box.right - box.left);

      let bottom = 0, top = quantity.limit ? quantity.limit.m * 1.05 : 0;
      for (const row of visible) top = Math.max(top, row.high ?? row.y, row.y);
      if (quantity.rate) top = top > .5 ? 1 : top * 1.08 || 1;
      else top = top || 1;
      let py, marks, label;
      if (state.log) {
        const positive = visible.flatMap((r) => [r.y, r.y > 0 ? r.low : r.high]).filter((v) => v !== null && v > FLOOR);
        const lowest = Math.floor(Math.log10(Math.min(...positive, top)) - 1e-9), highest = Math.ceil(Math.log10(top) - 1e-9);
        const span = Math.max(1, highest - lowest), every = Math.ceil(span / Math.max(4, Math.floor(height / 50)));
        bottom = 10 ** lowest;
        py = (y) => box.bottom - (Math.log10(Math.max(y, bottom)) - lowest) / span * (box.bottom - box.top);
        marks = Array.from({length: span + 1}, (_, k) => lowest + k).filter((k) => (k - lowest) % every === 0).map((k) => 10 ** k);
        label = (y) => quantity.rate ? y.toExponential(0).replace("e+0", "").replace("e+", "e") : digits(y);
      } else {
        py = (y) => box.bottom - y / top * (box.bottom - box.top);
        marks = ticks(0, top, height / 60);
        label = (y) => quantity.rate ? `${+(100 * y).toPrecision(3)} %` : digits(y);
      }
      for (const y of marks) {
        make(svg, "line", {class: "grid", x1: box.left, x2: box.right, y1: py(y), y2: py(y)});
        make(svg, "text", {x: box.left - 6, y: py(y) + 4, "text-anchor": "end"}, label(y));
      }
      for (const x of ticks(reach[0], reach[1], width / 80)) {
        make(svg, "line", {class: "grid", x1: px(x), x2: px(x), y1: box.bottom, y2: box.bottom + 4});
        make(svg, "text", {x: px(x), y: box.bottom + 17, "text-anchor": "middle"}, digits(x));
      }
      make(svg, "line", {class: "axis", x1: box.left, x2: box.right, y1: box.bottom, y2: box.bottom});
      make(svg, "text", {x: (box.left + box.right) / 2, y: height - 6, "text-anchor": "middle"}, data.x);
      make(svg, "text", {x: 4, y: 14}, quantity.label);
      if (quantity.limit) {
        const y = py(quantity.limit.m), words = `${quantity.limit.name} ${digits(quantity.limit.m)} m`;
        make(svg, "line", {class: "limit", x1: box.left, x2: box.right, y1: y, y2: y});
        make(svg, "text", {x: box.right, y: y - 4, "text-anchor": "end"}, words);
      }
      data.curves.forEach((name, k) => {
        if (!state.shown[k]) return;
        const line = visible.filter((row) => row.curve === k);
        for (const bound of parts(line.filter((row) => row.low !== null && row.high !== null))) {
          if (bound.length < 2) continue;
          const up = bound.map((row) => `${px(row.x)},${py(row.high)}`), down = bound.map((row) => `${px(row.x)},${py(row.low)}`);
          make(svg, "polygon", {class: `band c${k % COLOURS}`, points: [...up, ...down.reverse()].join(" ")});
        }
        const seen = state.log ? line.filter((row) => row.y > FLOOR) : line;
        for (const part of parts(seen)) {
          const points = part.map((row) => `${px(row.x)},${py(row.y)}`).join(" ");
          style(make(svg, "polyline", {points, fill: "none", "stroke-width": 1.6}), k);
        }
        if (line.length <= 80) line.forEach((row) => {
          const none = row.y === 0 && row.high > 0;
          if (state.log && row.y <= FLOOR && !none) return;
          if (row.high !== null && row.high > row.low && !none)
            make(svg, "line", {class: `c${k % COLOURS}`, x1: px(row.x), x2: px(row.x), y1: py(row.low), y2: py(row.high)});
          const y = py(none && state.log ? row.high : row.y);
          if (none && state.log)
            make(svg, "path", {class: `c${k % COLOURS}`, fill: "none", d: `M${px(row.x)} ${y}v14m-3 -4l3 4l3 -4`});
          SHAPES[k % SHAPES.length](svg, px(row.x), y, 3.2, {class: `c${k % COLOURS} ${none ? "hollow" : "solid"}`});
        });
      });
      const guide = make(svg, "line", {class: "guide", y1: box.top, y2: box.bottom, x1: 0, x2: 0, visibility: "hidden"});

      const show = (x) => {
        state.at = x;
        if (x === null) { tip.hidden = true; guide.setAttribute("visibility", "hidden"); return; }
        guide.setAttribute("x1", px(x)); guide.setAttribute("x2", px(x)); guide.setAttribute("visibility", "visible");
        tip.replaceChildren();
        element(tip, "strong", {}, `${data.x.replace(/ \[.*/, "")} ${digits(x)} ${unit}`);
        for (const row of visible.filter((one) => one.x === x)) {
          const entry = element(tip, "div");
          element(entry, "span", {class: `key c${row.curve % COLOURS}`, "aria-hidden": "true"});
          element(entry, "span", {}, `${data.curves[row.curve]}: ${valueText(row, quantity)}`);
        }
        tip.hidden = false;
        const scaleX = svg.getBoundingClientRect().width / width, half = px(x) * scaleX;
        const room = canvas.clientWidth, wide = tip.offsetWidth;
        const left = half + 14 + wide <= room ? half + 14 : Math.max(0, Math.min(room - wide, half - 14 - wide));
        tip.style.left = `${left}px`;
        tip.style.top = `${box.top}px`;
      };
      const nearest = (event) => {
        const frame = svg.getBoundingClientRect(), at = (event.clientX - frame.left) * width / frame.width;
        return xs.reduce((a, b) => Math.abs(px(b) - at) < Math.abs(px(a) - at) ? b : a);
      };
      svg.addEventListener("pointermove", (event) => show(nearest(event)));
      svg.addEventListener("pointerdown", (event) => show(nearest(event)));
      svg.addEventListener("pointerleave", () => show(null));
      svg.addEventListener("blur", () => show(null));
      svg.addEventListener("keydown", (event) => {
        const step = {ArrowLeft: -1, ArrowRight: 1}[event.key], at = xs.indexOf(state.at);
        if (event.key === "Escape") show(null);
        if (!step) return;
        event.preventDefault();
        show(xs[at < 0 ? (step > 0 ? 0 : xs.length - 1) : Math.min(xs.length - 1, Math.max(0, at + step))]);
      });
    }
    draw();
    // On paper nothing can be pressed: every curve is there, and what was hidden is hidden again.
    let before = null;
    addEventListener("beforeprint", () => {
      before ??= state.shown;
      state.shown = before.map(() => true);
      buttons.forEach((button) => button.setAttribute("aria-pressed", true));
      draw();
    });
    addEventListener("afterprint", () => {
      state.shown = before ?? state.shown;
      before = null;
      buttons.forEach((button, k) => button.setAttribute("aria-pressed", state.shown[k]));
      draw();
    });
    let drawnAt = canvas.clientWidth;
    // In the next frame: a size must not change while sizes are being told.
    new ResizeObserver(() => requestAnimationFrame(() => {
      if (Math.abs(canvas.clientWidth - drawnAt) > 8) { drawnAt = canvas.clientWidth; draw(); }
    })).observe(canvas);
  }

  // Without a script there is nothing to see here, and the figures below stand in for it.
  for (const hidden of document.querySelectorAll(".needs-script")) hidden.hidden = false;
  for (const data of JSON.parse(source.textContent)) {
    const place = document.getElementById(`chart-${data.id}`);
    if (place) chart(data, place);
  }
})();
