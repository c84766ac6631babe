// Shows the values of a plot's curves: at the pointer, or where the arrow keys lead.
//
// A plot is an outer <svg data-x data-y> (labels of its axes) around an inner <svg data-range> (x and y at its edges).
// Each <path data-name> in it is a curve through the places of its "d". data-along holds what its points are identified by,
// such as times; without it, that is their x. data-error holds standard errors of y.
"use strict";
(() => {
  const MOST_CURVES = 6; // in one reading
  const SAME = 0.02; // of the extent of a curve: how near a point must be to belong to the reading
  const STEPS = 100; // of the arrow keys along a curve

  const numbers = (text) => (text ? text.split(" ").map(Number) : []);
  const nearest = (values, value) =>
    values.reduce((best, one, k) => (Math.abs(one - value) < Math.abs(values[best] - value) ? k : best), 0);
  const extent = (values) => Math.max(...values) - Math.min(...values);
  // As many digits as a drawing resolves.
  const written = (value, range) =>
    value.toFixed(Math.min(Math.max(Math.ceil(-Math.log10(range / 1000)), 0), 6)).replace("-", "\u2212");

  const box = document.createElement("div");
  box.className = "reading";
  box.setAttribute("role", "status");
  box.hidden = true;
  document.querySelector("main").append(box);
  let owner = null; // the plot whose values the box shows

  class Plot {
    constructor(svg) {
      this.svg = svg;
      this.area = svg.querySelector("svg[data-range]");
      [this.x0, this.x1, this.y0, this.y1] = numbers(this.area.dataset.range);
      [this.left, this.top, this.width, this.height] = ["x", "y", "width", "height"].map((key) =>
        Number(this.area.getAttribute(key)),
      );
      this.curves = [...this.area.querySelectorAll("path[data-name]")].map((path) => this.curve(path));
      this.marks = document.createElementNS(svg.namespaceURI, "g");
      this.area.append(this.marks);
    }

    curve(path) {
      const places = [...path.getAttribute("d").matchAll(/[ML](-?[\d.]+) (-?[\d.]+)/g)].map((m) => [+m[1], +m[2]]);
      const x = places.map(([across]) => this.x0 + (across / this.width) * (this.x1 - this.x0));
      const keys = path.dataset.along ? numbers(path.dataset.along) : x;
      return { name: path.dataset.name, places, keys, errors: numbers(path.dataset.error), stroke: path.getAttribute("stroke") };
    }

    // The curve and the point nearest to a place on the screen: on a map in both directions, else by x alone.
    at(clientX, clientY) {
      const point = new DOMPoint(clientX, clientY).matrixTransform(this.svg.getScreenCTM().inverse());
      const [across, down] = [point.x - this.left, point.y - this.top];
      let best = { distance: Infinity };
      for (const curve of this.curves) {
        const flat = this.area.dataset.along ? 1 : 0.01;
        curve.places.forEach(([x, y], k) => {
          const distance = Math.hypot(x - across, flat * (y - down));
          if (distance < best.distance) best = { distance, curve, k };
        });
      }
      return best.curve && best;
    }

    // Show what all curves have where one of them has its point k.
    show(curve, k) {
      const key = curve.keys[k];
      const [x, y] = curve.places[k];
      const read = this.curves
        .map((one) => ({ one, at: one.keys.length ? nearest(one.keys, key) : -1 }))
        .filter(({ one, at }) => at >= 0 && Math.abs(one.keys[at] - key) <= SAME * (extent(one.keys) || 1))
        .sort((a, b) => Math.hypot(a.one.places[a.at][0] - x, a.one.places[a.at][1] - y) - Math.hypot(b.one.places[b.at][0] - x, b.one.places[b.at][1] - y))
        .slice(0, MOST_CURVES);
      this.mark(read.map(({ one, at }) => one.places[at]));
      box.replaceChildren(`${this.area.dataset.along || this.svg.dataset.x}: ${this.key(key, curve)}`);
      for (const { one, at } of read) {
        const row = document.createElement("div");
        row.style.borderLeft = `4px solid ${one.stroke}`;
        row.style.paddingLeft = "6px";
        row.textContent = `${one.name}: ${this.values(one, at)}`;
        box.append(row);
      }
      this.put(x, y);
    }

    key(key, curve) {
      return written(key, this.area.dataset.along ? extent(curve.keys) || 1 : this.x1 - this.x0);
    }

    values(curve, k) {
      const x = this.x0 + (curve.places[k][0] / this.width) * (this.x1 - this.x0);
      const y = this.y1 - (curve.places[k][1] / this.height) * (this.y1 - this.y0);
      const [value, range] = [written(y, this.y1 - this.y0), this.y1 - this.y0];
      if (this.area.dataset.along) return `${this.svg.dataset.x} ${written(x, this.x1 - this.x0)}, ${this.svg.dataset.y} ${value}`;
      return curve.errors.length ? `${value} \u00b1 ${written(curve.errors[k], range)}` : value;
    }

    mark(places) {
      this.marks.replaceChildren(
        ...places.map(([x, y]) => {
          const dot = document.createElementNS(this.svg.namespaceURI, "circle");
          Object.entries({ cx: x, cy: y, r: 4, fill: "none", stroke: "var(--ink)", "stroke-width": 1.5 }).forEach(
            ([name, value]) => dot.setAttribute(name, value),
          );
          return dot;
        }),
      );
    }

    // Put the box beside a place of the plot, where the window has room.
    put(x, y) {
      const place = new DOMPoint(x + this.left, y + this.top).matrixTransform(this.svg.getScreenCTM());
      if (owner !== this) owner?.hide();
      owner = this;
      box.hidden = false;
      const [width, height] = [box.offsetWidth, box.offsetHeight];
      const right = place.x + 16 + width < innerWidth ? place.x + 16 : Math.max(place.x - 16 - width, 4);
      const below = Math.min(Math.max(place.y + 16, 4), innerHeight - height - 4);
      box.style.left = `${scrollX + Math.min(right, innerWidth - width - 4)}px`;
      box.style.top = `${scrollY + below}px`;
    }

    hide() {
      this.marks.replaceChildren();
      if (owner !== this) return;
      owner = null;
      box.hidden = true;
    }
  }

  // Listen to the pointer and to the keys; a plot is taken apart when it is first needed.
  function listen(svg) {
    let plot, curve, k;
    const ready = () => (plot ??= new Plot(svg));
    const show = () => plot.show(curve, k);
    const point = (event) => {
      const found = ready().at(event.clientX, event.clientY);
      if (!found) return;
      [curve, k] = [found.curve, found.k];
      show();
    };
    svg.tabIndex = 0;
    svg.addEventListener("pointermove", point);
    svg.addEventListener("pointerdown", point);
    // A finger that is lifted leaves the value there, to be read.
    svg.addEventListener("pointerleave", (event) => event.pointerType === "mouse" && plot?.hide());
    svg.addEventListener("blur", () => plot?.hide());
    svg.addEventListener("keydown", (event) => {
      if (event.key === "Escape") return plot?.hide();
      const [along, across] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key] || [];
      if (along === undefined || !ready().curves.length) return;
      event.preventDefault();
      const { curves } = plot;
      const number = curve ? (curves.indexOf(curve) + across + curves.length) % curves.length : 0;
      const share = curve ? k / curve.keys.length : 0;
      const moved = curve && along ? along * Math.ceil(curve.keys.length / STEPS) : 0;
      curve = curves[number];
      k = Math.min(Math.max((across ? Math.round(share * curve.keys.length) : k || 0) + moved, 0), curve.keys.length - 1);
      show();
    });
  }

  document.querySelectorAll("svg[data-x]:has(path[data-name])").forEach(listen);
})();
