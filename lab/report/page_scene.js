// Draws the arm in 3D: turned by dragging, zoomed by wheel or pinch, at one pose or moment at a time. The page reads
// without it.
document.querySelectorAll(".scene").forEach((box) => {
  const data = JSON.parse(box.querySelector("script").textContent);
  const canvas = box.querySelector("canvas"), gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) return;
  box.classList.add("live");
  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
  const floats = (text) => new Float32Array(bytes(text));
  const poses = data.names.length, places = floats(data.places), points = floats(data.points);
  const vector = (of, i) => [of[3 * i], of[3 * i + 1], of[3 * i + 2]];

  // Matrices are column by column.
  const product = (a, b) => {
    const c = new Float32Array(16);
    for (let i = 0; i < 4; i++) for (let j = 0; j < 4; j++) for (let k = 0; k < 4; k++) c[4 * j + i] += a[4 * k + i] * b[4 * j + k];
    return c;
  };
  const minus = (a, b) => a.map((part, i) => part - b[i]), size = (a) => Math.hypot(...a);
  const scaled = (a, by) => a.map((part) => part * by), plus = (a, b) => a.map((part, i) => part + b[i]);
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => scaled(a, 1 / (size(a) || 1));
  const frame = (x, y, z, p) => new Float32Array([...x, 0, ...y, 0, ...z, 0, ...p, 1]);

  const shader = (kind, text) => {
    const made = gl.createShader(kind);
    gl.shaderSource(made, "#version 300 es\nprecision highp float;\n" + text);
    gl.compileShader(made);
    return made;
  };
  const program = gl.createProgram();
  gl.attachShader(program, shader(gl.VERTEX_SHADER,
    "in vec3 at; uniform mat4 view, model; out vec3 seen; void main() { vec4 w = model * vec4(at, 1.0); seen = w.xyz; gl_Position = view * w; }"));
  gl.attachShader(program, shader(gl.FRAGMENT_SHADER,
    "in vec3 seen; uniform vec4 tint; uniform vec3 eye; out vec4 colour; void main() { vec3 n = normalize(cross(dFdx(seen), dFdy(seen)));" +
    " float light = 0.45 + 0.55 * abs(dot(n, normalize(eye - seen))); colour = vec4(tint.rgb * light, tint.a); }"));
  gl.linkProgram(program);
  gl.useProgram(program);
  const where = Object.fromEntries(["view", "model", "tint", "eye"].map((name) => [name, gl.getUniformLocation(program, name)]));
  const mesh = (vertices, faces) => {
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, vertices, gl.STATIC_DRAW);
    const at = gl.getAttribLocation(program, "at");
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, 3, gl.FLOAT, false, 0, 0);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
    return { array, count: faces.length, kind: faces.BYTES_PER_ELEMENT === 2 ? gl.UNSIGNED_SHORT : gl.UNSIGNED_INT };
  };
  const turned = (profile, sides) => { // a surface of revolution about z, of radii and heights
    const vertices = [], faces = [];
    profile.forEach(([radius, height], k) => {
      for (let i = 0; i < sides; i++) {
        const angle = (2 * Math.PI * i) / sides, next = (i + 1) % sides;
        vertices.push(radius * Math.cos(angle), radius * Math.sin(angle), height);
        if (k) faces.push((k - 1) * sides + i, (k - 1) * sides + next, k * sides + i, (k - 1) * sides + next, k * sides + next, k * sides + i);
      }
    });
    return mesh(new Float32Array(vertices), new Uint16Array(faces));
  };
  const arc = (count) => [...Array(count + 1).keys()].map((i) => [Math.sin((Math.PI * i) / count), -Math.cos((Math.PI * i) / count)]);
  const ball = turned(arc(8), 12), rod = turned([[0, 0], [1, 0], [1, 1], [0, 1]], 8), tip = turned([[0, 0], [1, 0], [0, 1]], 10);
  const shells = data.shells.map((shell) => ({ ...shell, mesh: mesh(floats(shell.vertices), new Uint16Array(bytes(shell.faces))) }));
  const arrows = data.arrows.map((kind) => ({ ...kind, vectors: floats(kind.vectors) }));
  const axes = data.axes && { ...data.axes, halves: floats(data.axes.halves) };
  const legs = floats(data.legs), moments = data.times ? data.times.length : poses;
  const legCount = moments ? legs.length / moments / 6 : 0;
  const lines = data.lines.map((each) => ({ ...each, points: floats(each.points) }));
  const surfaces = data.surfaces.map((each) => ({ ...each, mesh: mesh(floats(each.vertices), new Uint16Array(bytes(each.faces))) }));
  const momentOf = (pose) => (data.stops ? data.stops[pose] : pose);

  // show.at is a moment of the motion, which may lie between two; without a motion, the number of the pose.
  const show = { at: momentOf(data.first), turn: 0.6, raise: 0.35, distance: 2.6 * data.radius, middle: data.middle };
  let view, eye, start = { ...show };
  const look = () => {
    const ratio = window.devicePixelRatio || 1, wide = canvas.clientWidth, high = canvas.clientHeight;
    canvas.width = wide * ratio;
    canvas.height = high * ratio;
    gl.viewport(0, 0, canvas.width, canvas.height);
    const away = [Math.cos(show.raise) * Math.sin(show.turn), -Math.cos(show.raise) * Math.cos(show.turn), Math.sin(show.raise)];
    eye = plus(show.middle, scaled(away, show.distance));
    const right = unit(cross([0, 0, 1], away)), up = cross(away, right), near = show.distance / 100, far = show.distance + 6 * data.radius;
    const turn = new Float32Array([right[0], up[0], away[0], 0, right[1], up[1], away[1], 0, right[2], up[2], away[2], 0, 0, 0, 0, 1]);
    const shift = frame([1, 0, 0], [0, 1, 0], [0, 0, 1], scaled(eye, -1)), f = 2.2, slim = Math.min(1, wide / high);
    view = product(new Float32Array([(f * slim * high) / wide, 0, 0, 0, 0, f * slim, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0]), product(turn, shift));
    gl.uniformMatrix4fv(where.view, false, view);
    gl.uniform3fv(where.eye, eye);
  };
  const draw = (what, model, rgb, alpha = 1) => {
    gl.bindVertexArray(what.array);
    gl.uniformMatrix4fv(where.model, false, model);
    gl.uniform4f(where.tint, rgb[0] / 255, rgb[1] / 255, rgb[2] / 255, alpha);
    gl.drawElements(gl.TRIANGLES, what.count, what.kind, 0);
  };
  const along = (what, from, to, thick, rgb, alpha) => {
    const z = minus(to, from);
    if (Number.isNaN(z[0])) return; // a line is parted here
    const side = unit(cross(z, Math.abs(z[2]) < 0.9 * size(z) ? [0, 0, 1] : [1, 0, 0]));
    draw(what, frame(scaled(side, thick), scaled(cross(unit(z), side), thick), z, from), rgb, alpha);
  };
  const arrow = (from, by, thick, rgb, alpha) => {
    const length = size(by);
    if (!(length > 0)) return;
    const head = Math.min(4 * thick, length), neck = plus(from, scaled(by, 1 - head / length));
    along(rod, from, neck, thick, rgb, alpha);
    along(tip, neck, plus(from, by), 2.5 * thick, rgb, alpha);
  };
  const screen = (p) => {
    const w = [0, 1, 2, 3].map((i) => view[i] * p[0] + view[4 + i] * p[1] + view[8 + i] * p[2] + view[12 + i]);
    return [((w[0] / w[3] + 1) / 2) * canvas.clientWidth, ((1 - w[1] / w[3]) / 2) * canvas.clientHeight];
  };
  const still = frame([1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]);
  const seeThrough = (paint) => {
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    paint();
    gl.depthMask(true);
  };
  const between = (values, width, count, at, k) => { // the k-th of count parts, interpolated between two moments
    const low = Math.floor(at), share = at - low, part = (j) => values.subarray(width * (j * count + k), width * (j * count + k + 1));
    return share ? part(low).map((value, n) => (1 - share) * value + share * part(low + 1)[n]) : part(low);
  };
  const timeAt = (at) => {
    const low = Math.floor(at), share = at - low;
    return share ? (1 - share) * data.times[low] + share * data.times[low + 1] : data.times[low];
  };
  const poseAt = (at) => (data.stops ? Math.max(0, data.stops.findLastIndex((stop) => stop <= at)) : at);
  const told = (i, standing) => (standing ? `${data.texts[i]}, at ` : i + 1 < poses ? `to ${data.texts[i + 1]}, at ` : "");
  const shown = (name) => box.querySelector(`[name="${name}"]`)?.checked ?? false;
  let written = []; // places of the labels
  const labels = box.querySelector(".labels"), slider = box.querySelector("input[type=range]");
  const label = (text, p) => { // below those that it would cover
    const made = document.createElement("span"), at = screen(p);
    while (written.some((other) => Math.abs(other[0] - at[0]) < 80 && Math.abs(other[1] - at[1]) < 17)) at[1] += 4;
    written.push(at);
    made.textContent = text;
    labels.append(made);
    made.style.left = `${Math.max(0, Math.min(at[0], labels.clientWidth - made.offsetWidth - 8))}px`;
    made.style.top = `${at[1]}px`;
  };
  const paint = () => {
    look();
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    labels.replaceChildren();
    written = [];
    const i = poseAt(show.at), standing = momentOf(i) === show.at, thin = 0.004 * data.radius;
    if (shown("arm")) shells.forEach((shell, b) => draw(shell.mesh, between(places, 16, shells.length, show.at, b), shell.rgb));
    for (let k = 0; k < legCount; k++) {
      const ends = between(legs, 6, legCount, show.at, k);
      along(rod, vector(ends, 0), vector(ends, 1), 2 * thin, [242, 97, 15]);
    }
    lines.filter((each) => shown(each.name)).forEach((each) => {
      for (let k = 1; k < each.rgb.length; k++) along(rod, vector(each.points, k - 1), vector(each.points, k), 0.9 * thin, each.rgb[k]);
    });
    for (let k = 0; k < poses; k++) {
      const here = k === i && standing, p = vector(points, k), r = (here ? 3.2 : 1.8) * thin;
      if (here || shown("others")) draw(ball, frame([r, 0, 0], [0, r, 0], [0, 0, r], p), data.colours[k]);
      arrows.forEach((kind) => (here || shown("others")) && shown(kind.name) &&
        arrow(p, scaled(vector(kind.vectors, k), kind.factor), (here ? 1.6 : 0.8) * thin, kind.rgb));
    }
    if (axes && standing && shown("axes")) {
      const centre = vector(points, i), halves = [0, 1, 2].map((k) => vector(axes.halves, 3 * i + k));
      halves.forEach((half, k) => {
        along(rod, minus(centre, half), plus(centre, half), thin, axes.rgb);
        label(axes.lengths[i][k], plus(centre, half));
      });
      seeThrough(() => draw(ball, frame(...halves, centre), axes.rgb, 0.3));
    }
    seeThrough(() => {
      for (let k = 0; k < poses; k++) if (k !== i && shown("ghosts"))
        shells.forEach((shell, b) => draw(shell.mesh, between(places, 16, shells.length, momentOf(k), b), shell.rgb, data.opacity));
      surfaces.filter((each) => shown(each.name)).forEach((each) => draw(each.mesh, still, each.rgb, 2 * data.opacity));
    });
    const named = moments < 2 ? [] : data.times && poses <= 12 ? data.names.map((_, k) => k) : standing ? [i] : [];
    named.forEach((k) => label(data.names[k], vector(points, k)));
    slider.value = Math.round(show.at);
    box.querySelector("output").textContent = moments < 2 ? "" : data.times ? `${told(i, standing)}${timeAt(show.at).toFixed(2)} s` : data.texts[i];
  };
  const row = (i) => {
    const rows = box.querySelectorAll("tbody tr");
    rows.forEach((each) => each.classList.toggle("chosen", each.dataset.pose === String(i)));
  };
  const go = (at) => {
    show.at = at;
    row(poseAt(at));
    paint();
  };
  const choose = (i) => go(momentOf(i));
  slider.addEventListener("input", () => go(Number(slider.value)));
  box.querySelectorAll("input[type=checkbox]").forEach((each) => each.addEventListener("change", paint));
  document.addEventListener("chosen", ({ detail }) => { // a point of a chart
    const i = detail.thing === "pose" ? data.names.indexOf(detail.name) : -1;
    if (i >= 0) choose(i);
  });
  box.querySelectorAll("tbody tr").forEach((each) => each.addEventListener("click", () => choose(Number(each.dataset.pose))));
  const held = new Map();
  let moved = 0;
  canvas.addEventListener("pointerdown", (event) => {
    held.set(event.pointerId, [event.clientX, event.clientY]);
    canvas.setPointerCapture(event.pointerId);
    moved = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = held.get(event.pointerId);
    if (!last) return;
    const by = [event.clientX - last[0], event.clientY - last[1]], apart = () => {
      const [a, b] = [...held.values()];
      return Math.hypot(a[0] - b[0], a[1] - b[1]);
    };
    const before = held.size === 2 ? apart() : 0;
    held.set(event.pointerId, [event.clientX, event.clientY]);
    moved += Math.hypot(...by);
    if (before) show.distance *= before / apart();
    else {
      show.turn -= 0.008 * by[0];
      show.raise = Math.max(-1.5, Math.min(1.5, show.raise + 0.008 * by[1]));
    }
    paint();
  });
  const release = (event) => {
    held.delete(event.pointerId);
    if (moved > 4 || event.type !== "pointerup") return;
    const edge = canvas.getBoundingClientRect(), at = [event.clientX - edge.left, event.clientY - edge.top];
    const far = [...Array(poses).keys()].map((i) => size(minus(screen(vector(points, i)), at)));
    const nearest = far.indexOf(Math.min(...far));
    if (far[nearest] < 16) choose(nearest);
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    show.distance *= Math.exp(0.001 * event.deltaY);
    paint();
  }, { passive: false });
  canvas.addEventListener("dblclick", () => {
    Object.assign(show, start, { at: show.at });
    paint();
  });
  canvas.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
    if (!step) return;
    event.preventDefault();
    show.turn += step[0];
    show.raise = Math.max(-1.5, Math.min(1.5, show.raise + step[1]));
    paint();
  });
  const button = box.querySelector("button");
  let playing = null;
  button.hidden = slider.closest("label").hidden = moments < 2;
  const stop = () => {
    clearInterval(playing);
    playing = null;
    button.textContent = "play";
  };
  const follow = (begun) => { // the motion in its own time, to its end
    const time = (performance.now() - begun) / 1e3, next = data.times.findIndex((each) => each > time);
    if (next < 0) {
      stop();
      return go(moments - 1);
    }
    const low = Math.max(next - 1, 0), step = data.times[next] - data.times[low];
    go(low + (step > 0 ? Math.max(0, time - data.times[low]) / step : 0));
  };
  button.addEventListener("click", () => {
    if (playing) return stop();
    const first = data.times && show.at < moments - 1 ? timeAt(show.at) : 0, begun = performance.now() - 1e3 * first;
    playing = data.times ? setInterval(() => follow(begun), 33) : setInterval(() => choose((show.at + 1) % poses), 600);
    button.textContent = "stop";
  });
  const fill = () => { // the distance from which everything just fits
    const all = [...Array(poses).keys()].map((k) => vector(points, k));
    lines.forEach((each) => each.rgb.forEach((_, k) => all.push(vector(each.points, k))));
    for (let k = 0; k < places.length / 16; k++) all.push([...places.subarray(16 * k + 12, 16 * k + 15)]);
    [...shells, ...surfaces].forEach((shell, b) => {
      const corners = floats(shell.vertices), T = b < shells.length ? between(places, 16, shells.length, show.at, b) : still;
      for (let k = 0; k < corners.length; k += 3)
        all.push([0, 1, 2].map((n) => T[n] * corners[k] + T[4 + n] * corners[k + 1] + T[8 + n] * corners[k + 2] + T[12 + n]));
    });
    const drawn = all.filter((p) => !Number.isNaN(p[0])), wide = canvas.clientWidth / 2, high = canvas.clientHeight / 2;
    for (let round = 0; wide && round < 4; round++) { // on paper the canvas has no width
      look();
      const beyond = drawn.map(screen).map(([x, y]) => Math.max(Math.abs(x / wide - 1), Math.abs(y / high - 1)));
      show.distance *= Math.max(0.4, Math.min(1.5, 1.1 * beyond.reduce((a, b) => Math.max(a, b), 0)));
    }
    start = { ...show };
  };
  new ResizeObserver(paint).observe(canvas);
  fill();
  paint();
});
