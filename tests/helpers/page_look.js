// What is wrong with a page as it is shown: cut or overflowing text, and text too pale to be read.
(() => {
  const wrong = [];
  document.querySelectorAll("details").forEach((each) => { each.open = true; }); // what is folded is looked at too
  const room = document.documentElement.clientWidth;
  if (document.documentElement.scrollWidth > room) wrong.push(`scrolls aside: ${document.documentElement.scrollWidth} > ${room}`);
  const canvas = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const colours = new Map();
  const rgba = (text) => {
    if (!colours.has(text)) {
      canvas.clearRect(0, 0, 1, 1);
      canvas.fillStyle = text;
      canvas.fillRect(0, 0, 1, 1);
      const [r, g, b, a] = canvas.getImageData(0, 0, 1, 1).data;
      colours.set(text, [r, g, b, a / 255]);
    }
    return colours.get(text);
  };
  const luminance = ([r, g, b]) => [r, g, b].map((c) => c / 255)
    .map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4))
    .reduce((sum, c, i) => sum + c * [0.2126, 0.7152, 0.0722][i], 0);
  const contrast = (a, b) => {
    const [x, y] = [luminance(a), luminance(b)].sort((p, q) => q - p);
    return (x + 0.05) / (y + 0.05);
  };
  const over = (top, under) => [0, 1, 2].map((i) => top[i] * top[3] + under[i] * (1 - top[3])).concat(1);
  const clear = (style) => style.visibility === "hidden" || style.display === "none" || style.opacity === "0";
  // The colour under a place of an element: what is painted there, from the paper up. Pictures of pixels are not known.
  const under = (element, x, y) => {
    const layers = [];
    for (const each of document.elementsFromPoint(x, y)) {
      if (each === element || element.contains(each) || each.closest("text")) continue;
      const style = getComputedStyle(each);
      if (each.tagName === "image") return null;
      const drawn = each instanceof SVGElement && each.tagName !== "svg";
      const paint = drawn ? (style.fill === "none" ? "transparent" : style.fill) : style.backgroundColor;
      if (paint.startsWith("url")) return null;
      const [r, g, b, a] = rgba(paint);
      layers.push([r, g, b, a * (drawn ? style.fillOpacity : 1) * style.opacity]);
      if (layers.at(-1)[3] > 0.999) break;
    }
    const own = element instanceof SVGElement ? [] : [rgba(getComputedStyle(element).backgroundColor)];
    return [...own, ...layers].reverse().reduce((below, top) => over(top, below), [255, 255, 255, 1]);
  };
  const lines = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  let texts = 0;
  for (let node = lines.nextNode(); node; node = lines.nextNode()) {
    const element = node.parentElement;
    const words = node.textContent.trim();
    if (!words || element.closest("script, style, defs, title, [aria-hidden]")) continue;
    const style = getComputedStyle(element);
    const range = document.createRange();
    range.selectNodeContents(node);
    const box = range.getBoundingClientRect();
    if (!box.width || clear(style)) continue;
    texts += 1;
    const told = `${element.tagName} "${words.slice(0, 40)}"`;
    const svg = element.closest("svg");
    const frame = svg && svg.getBoundingClientRect();
    const cut = frame && (box.left < frame.left - 1 || box.right > frame.right + 1
      || box.top < frame.top - 1 || box.bottom > frame.bottom + 1);
    if (cut) wrong.push(`cut by its picture: ${told}`);
    for (let each = element; each && !svg; each = each.parentElement) {
      const held = getComputedStyle(each);
      const inner = each.getBoundingClientRect();
      if (held.overflowX === "auto" || held.overflowX === "scroll") break; // a finger moves what is in it
      if (held.display === "inline" || held.display === "contents") continue;
      if (box.right > inner.right + 1 || box.left < inner.left - 1) {
        wrong.push(`sticks out of its ${each.tagName}: ${told}`);
        break;
      }
    }
    const colour = rgba(svg ? style.fill : style.color);
    const [x, y] = [(box.left + box.right) / 2, (box.top + box.bottom) / 2];
    const scroller = (element.closest(".table") ?? document.documentElement).getBoundingClientRect();
    if (x < Math.max(0, scroller.left) || x > Math.min(room, scroller.right)) continue; // scrolled aside in its table
    const below = under(element, x, y);
    if (!below) continue;
    const alpha = colour[3] * (svg ? style.fillOpacity : 1) * style.opacity;
    const ratio = contrast(over([...colour.slice(0, 3), alpha], below), below);
    if (ratio < 4.5) wrong.push(`pale, ${ratio.toFixed(2)}: ${told}`);
  }
  const figures = [...document.querySelectorAll("figure")].map((figure) => figure.id);
  const sizes = [...document.querySelectorAll("figure svg")].map((svg) => {
    const box = svg.getBoundingClientRect();
    const many = (what) => svg.querySelectorAll(what).length;
    return [box.width, box.height, many("path"), many("text"), Number(svg.classList.contains("small"))];
  });
  return { wrong: [...new Set(wrong)], texts, figures, sizes };
})()
