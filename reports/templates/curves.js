// Curves of a figure drawn again from its numbers: hover, zoom, runs on and off; the picture stays for print.
(function () {
  const NS = "http://www.w3.org/2000/svg", W = 720, H = 420, LEFT = 66, RIGHT = 12, TOP = 10, BOTTOM = 46;
  const short = (v) => String(+v.toPrecision(5));
  const clip = (v, low, high) => Math.min(Math.max(v, low), high);

  function ticks(low, high) {
    const raw = (high - low) / 6, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].find((s) => s * power >= raw) * power, found = [];
    for (let i = Math.ceil(low / step); i * step <= high; i++) found.push(+(i * step).toPrecision(12));
    return found;
  }

  function chart(figure) {
    const data = JSON.parse(figure.querySelector("script[type='application/json']").textContent), lines = data.lines;
    const box = document.createElement("div"), on = lines.map(() => true);
    const first = Math.max(0, lines.findIndex((line) => !line.points)), size = lines[first].y.map(Math.abs);
    let view, at = { line: first, point: size.indexOf(size.reduce((a, b) => Math.max(a, b), 0)) }, drag = null;
    box.className = "chart";
    figure.insertBefore(box, figure.querySelector("figcaption"));
    figure.classList.add("interactive");

    function node(name, attributes, parent) {
      const made = document.createElementNS(NS, name);
      for (const key in attributes) made.setAttribute(key, attributes[key]);
      if (parent) parent.appendChild(made);
      return made;
    }
    const svg = node("svg", { viewBox: `0 0 ${W} ${H}`, tabindex: 0, role: "group" }, box);
    svg.setAttribute("aria-label", `${data.title}. Arrow keys walk along a curve and to the next one, plus and minus zoom, 0 shows all.`);
    const output = document.createElement("output"), legend = document.createElement("div"), all = document.createElement("button");
    output.setAttribute("aria-live", "polite");
    legend.className = "legend";
    all.type = "button";
    all.textContent = "Show all";
    box.append(output, legend);

    function whole() {
      const shown = lines.filter((_, i) => on[i]), x = shown.flatMap((l) => l.x), y = shown.flatMap((l) => l.y).concat(0);
      if (!x.length) return [0, 1, 0, 1];
      const span = (v) => [v.reduce((a, b) => Math.min(a, b)), v.reduce((a, b) => Math.max(a, b))];
      const [a, b] = span(x), [c, d] = span(y), dx = 0.03 * (b - a || 1), dy = 0.05 * (d - c || 1);
      return [a - dx, b + dx, c - dy, d + dy];
    }
    const px = (x) => LEFT + (x - view[0]) / (view[1] - view[0]) * (W - LEFT - RIGHT);
    const py = (y) => H - BOTTOM - (y - view[2]) / (view[3] - view[2]) * (H - TOP - BOTTOM);
    const ux = (p) => view[0] + (p - LEFT) / (W - LEFT - RIGHT) * (view[1] - view[0]);
    const uy = (p) => view[2] + (H - BOTTOM - p) / (H - TOP - BOTTOM) * (view[3] - view[2]);

    function draw() {
      svg.replaceChildren();
      const grid = node("g", { class: "grid" }, svg);
      for (const x of ticks(view[0], view[1])) {
        node("line", { x1: px(x), x2: px(x), y1: TOP, y2: H - BOTTOM }, grid);
        node("text", { x: px(x), y: H - BOTTOM + 16, "text-anchor": "middle" }, grid).textContent = short(x);
      }
      for (const y of ticks(view[2], view[3])) {
        node("line", { x1: LEFT, x2: W - RIGHT, y1: py(y), y2: py(y) }, grid);
        node("text", { x: LEFT - 6, y: py(y) + 4, "text-anchor": "end" }, grid).textContent = short(y);
      }
      node("text", { x: (LEFT + W) / 2, y: H - 8, "text-anchor": "middle" }, grid).textContent = data.x;
      const side = { x: -(H - BOTTOM) / 2, y: 14, transform: "rotate(-90)", "text-anchor": "middle" };
      node("text", side, grid).textContent = data.y;
      const inside = node("svg", { x: LEFT, y: TOP, width: W - LEFT - RIGHT, height: H - TOP - BOTTOM, overflow: "hidden" }, svg);
      lines.forEach((line, i) => {
        if (!on[i]) return;
        const points = line.x.map((x, j) => [px(x) - LEFT, py(line.y[j]) - TOP]), style = { stroke: line.colour, class: "line" };
        if (line.points) for (const [cx, cy] of points) node("circle", { ...style, cx, cy, r: 3 }, inside);
        else node("polyline", { ...style, points: points.map((p) => p.map((v) => v.toFixed(1)).join()).join(" "), "stroke-dasharray": line.dash }, inside);
      });
      mark();
    }
    function mark() {
      svg.querySelectorAll(".mark").forEach((m) => m.remove());
      const line = lines[at.line], x = line.x[at.point], y = line.y[at.point];
      if (!on[at.line]) { output.textContent = "No curve is shown."; return; }
      output.textContent = `${line.name}: ${data.x} ${short(x)}, ${data.y} ${short(y)}`;
      if (px(x) >= LEFT && px(x) <= W - RIGHT && py(y) >= TOP && py(y) <= H - BOTTOM)
        node("circle", { class: "mark", cx: px(x), cy: py(y), r: 5, stroke: line.colour }, svg);
    }
    function nearest(event) {
      const [mx, my] = place(event);
      let best = Infinity;
      lines.forEach((line, i) => on[i] && line.x.forEach((x, j) => {
        const d = (px(x) - mx) ** 2 + (py(line.y[j]) - my) ** 2;
        if (d < best) { best = d; at = { line: i, point: j }; }
      }));
      mark();
    }
    function place(event) {
      const r = svg.getBoundingClientRect();
      return [(event.clientX - r.left) / r.width * W, (event.clientY - r.top) / r.height * H];
    }
    function show(next) { view = next || whole(); draw(); }
    function zoom(factor) {
      const line = lines[at.line], cx = line.x[at.point], cy = line.y[at.point], [a, b, c, d] = view;
      show([cx - (cx - a) * factor, cx + (b - cx) * factor, cy - (cy - c) * factor, cy + (d - cy) * factor]);
    }
    function other(step) {
      for (let i = 1; i <= lines.length; i++) {
        const line = (at.line + step * i + lines.length * i) % lines.length;
        if (on[line]) return { line, point: Math.min(at.point, lines[line].x.length - 1) };
      }
      return at;
    }
    svg.addEventListener("pointermove", (event) => {
      if (!drag) return nearest(event);
      const [x, y] = place(event);
      drag.box = drag.box || node("rect", { class: "drag" }, svg);
      const size = { x: Math.min(x, drag.x), y: Math.min(y, drag.y), width: Math.abs(x - drag.x), height: Math.abs(y - drag.y) };
      for (const key in size) drag.box.setAttribute(key, size[key]);
    });
    svg.addEventListener("pointerdown", (event) => { const [x, y] = place(event); drag = { x, y }; svg.setPointerCapture(event.pointerId); });
    svg.addEventListener("pointerup", (event) => {
      const [x, y] = place(event), from = drag;
      drag = null;
      if (from && Math.abs(x - from.x) > 8 && Math.abs(y - from.y) > 8)
        show([ux(Math.min(x, from.x)), ux(Math.max(x, from.x)), uy(Math.max(y, from.y)), uy(Math.min(y, from.y))]);
      else if (from && from.box) draw();
    });
    svg.addEventListener("dblclick", () => show());
    svg.addEventListener("keydown", (event) => {
      const last = lines[at.line].x.length - 1, jump = event.shiftKey ? 10 : 1;
      if (event.key === "ArrowRight") at.point = clip(at.point + jump, 0, last);
      else if (event.key === "ArrowLeft") at.point = clip(at.point - jump, 0, last);
      else if (event.key === "ArrowDown") at = other(1);
      else if (event.key === "ArrowUp") at = other(-1);
      else if (event.key === "+" || event.key === "=") zoom(0.5);
      else if (event.key === "-") zoom(2);
      else if (event.key === "0" || event.key === "Escape") show();
      else return;
      event.preventDefault();
      mark();
    });
    lines.forEach((line, i) => {
      const button = document.createElement("button"), sample = node("svg", { viewBox: "0 0 34 10", "aria-hidden": "true" }, button);
      button.type = "button";
      if (line.points) node("circle", { cx: 17, cy: 5, r: 3, stroke: line.colour, class: "line" }, sample);
      else node("line", { x1: 1, x2: 33, y1: 5, y2: 5, stroke: line.colour, class: "line", "stroke-dasharray": line.dash }, sample);
      button.append(line.name);
      button.setAttribute("aria-pressed", "true");
      button.addEventListener("click", () => {
        on[i] = !on[i];
        button.setAttribute("aria-pressed", String(on[i]));
        if (!on[at.line]) at = other(1);
        show();
      });
      legend.append(button);
    });
    all.addEventListener("click", () => show());
    legend.append(all);
    show();
  }
  document.querySelectorAll("figure.curves").forEach(chart);
})();
