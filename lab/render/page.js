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
