// Sorts a table by the column that is pressed, up, then down. The page reads without it.
document.querySelectorAll("table").forEach((table) => {
  table.querySelectorAll("thead th").forEach((head) => {
    const column = head.cellIndex; // an empty cell is not pressed
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const up = head.getAttribute("aria-sort") !== "ascending";
      const body = table.tBodies[0];
      const text = (row) => row.cells[column].textContent.trim();
      const size = (row) => parseFloat(text(row).replace(/\u2212/g, "-").replace(/[^\d.eE+-]/g, ""));
      const order = (a, b) => {
        const [x, y] = [size(a), size(b)];
        if (Number.isNaN(x) && Number.isNaN(y)) return text(a).localeCompare(text(b));
        if (Number.isNaN(x) || Number.isNaN(y)) return Number.isNaN(x) ? 1 : -1;
        return x - y || text(a).localeCompare(text(b), undefined, { numeric: true });
      };
      const words = head.classList.contains("number") ? order : (a, b) =>
        text(a).localeCompare(text(b), undefined, { numeric: true });
      const rows = [...body.rows].sort(words);
      body.append(...(up ? rows : rows.reverse()));
      table.querySelectorAll("thead th").forEach((each) => each.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", up ? "ascending" : "descending");
    });
  });
});

// Names the point of a chart that is pointed at, rings it in every chart, and marks its row in every table. A chart
// with named points takes the keyboard: arrow keys go from point to point, Enter chooses.
(() => {
  const charts = [...document.querySelectorAll("svg[data-points]")].map((svg) => {
    const points = svg.dataset.points.split("\n").map((line) => {
      const [x, y, thing, name, text] = line.split("\t");
      return { x: Number(x), y: Number(y), thing, name, text };
    });
    return { svg, points: points.sort((a, b) => a.x - b.x || a.y - b.y), at: -1 };
  });
  document.querySelectorAll(".panels").forEach((each) => { // a keyboard moves what a finger does
    const scrolls = () => { each.tabIndex = each.scrollWidth > each.clientWidth + 1 ? 0 : -1; };
    new ResizeObserver(scrolls).observe(each);
  });
  if (!charts.length) return;
  const tip = document.createElement("output");
  tip.className = "tip";
  tip.hidden = true;
  document.querySelector("main").append(tip);
  const rows = new Map();
  document.querySelectorAll("table").forEach((table) => {
    const thing = table.tHead?.rows[0].cells[0].textContent.trim();
    for (const row of thing ? table.tBodies[0].rows : []) {
      const key = `${thing}\t${row.cells[0].textContent.trim()}`;
      rows.set(key, [...(rows.get(key) ?? []), row]);
    }
  });
  const same = (one, other) => one && other.thing === one.thing && other.name === one.name;
  let shown = null;
  const ring = ({ svg }, { x, y }) => {
    const made = document.createElementNS(svg.namespaceURI, "circle");
    for (const [name, value] of Object.entries({ class: "ring", cx: x, cy: y, r: 6 })) made.setAttribute(name, value);
    svg.append(made);
  };
  const show = (chart, point) => { // no point: nothing is pointed at
    tip.hidden = !point;
    if (point) {
      const at = new DOMPoint(point.x, point.y).matrixTransform(chart.svg.getScreenCTM());
      tip.textContent = `${point.thing} ${point.name}: ${point.text}`;
      tip.style.left = `${Math.max(4, Math.min(at.x + 12, document.documentElement.clientWidth - tip.offsetWidth - 4))}px`;
      tip.style.top = `${at.y > tip.offsetHeight + 16 ? at.y - tip.offsetHeight - 10 : at.y + 14}px`;
    }
    if (point && same(shown, point)) return;
    shown = point;
    document.querySelectorAll(".ring").forEach((each) => each.remove());
    document.querySelectorAll("tr.pointed").forEach((each) => each.classList.remove("pointed"));
    if (!point) return;
    charts.forEach((each) => each.points.filter((other) => same(point, other)).forEach((other) => ring(each, other)));
    (rows.get(`${point.thing}\t${point.name}`) ?? []).forEach((row) => row.classList.add("pointed"));
  };
  const choose = (point) => document.dispatchEvent(new CustomEvent("chosen", { detail: point }));
  charts.forEach((chart) => {
    const { svg, points } = chart;
    svg.tabIndex = 0;
    const nearest = (event) => {
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      let found = -1, least = 12;
      points.forEach(({ x, y }, i) => {
        const far = Math.hypot(x - at.x, y - at.y);
        if (far < least) [found, least] = [i, far];
      });
      return found;
    };
    const go = (i) => {
      chart.at = i;
      show(chart, points[i] ?? null);
    };
    svg.addEventListener("pointermove", (event) => go(nearest(event)));
    svg.addEventListener("pointerleave", (event) => event.pointerType === "mouse" && go(-1));
    svg.addEventListener("click", (event) => {
      go(nearest(event));
      if (points[chart.at]) choose(points[chart.at]);
    });
    svg.addEventListener("focus", () => svg.matches(":focus-visible") && go(0));
    svg.addEventListener("blur", () => go(-1));
    svg.addEventListener("keydown", (event) => {
      const last = points.length - 1;
      const next = { ArrowRight: Math.min(chart.at + 1, last), ArrowLeft: Math.max(chart.at - 1, 0), Home: 0, End: last, Escape: -1 };
      if (event.key === "Enter" && points[chart.at]) choose(points[chart.at]);
      if (!(event.key in next)) return;
      event.preventDefault();
      go(next[event.key]);
    });
  });
})();
