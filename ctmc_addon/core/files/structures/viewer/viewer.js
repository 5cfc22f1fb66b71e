// SPDX-License-Identifier: GPL-3.0-or-later
// Shows the structures that a page of CTMC holds. Space is RAS+ mm: x to the patient's right, y to the front, z up.
"use strict";
(() => {
  const T = window.CTMC3;
  const WORDS = {
    en: { cut: "Cut", none: "No cut", x: "Left to right", y: "Back to front", z: "Foot to head", flip: "Other side",
      all: "All", nothing: "None", picture: "Picture", light: "Light / dark", open: "open", fit: "Fit",
      views: ["Front", "Back", "Right", "Left", "Head", "Foot"], sides: "RLAPHF", show: "Show or hide the list",
      opacity: "Opacity", explode: "Explode", map: "Map", plain: "Plain color", without: "no value",
      failed: "This browser cannot show 3D (WebGL 2)." },
    de: { cut: "Schnitt", none: "Kein Schnitt", x: "Links nach rechts", y: "Hinten nach vorn", z: "Fuß nach Kopf",
      flip: "Andere Seite", all: "Alle", nothing: "Keine", picture: "Bild", light: "Hell / dunkel", open: "offen",
      fit: "Einpassen", views: ["Vorn", "Hinten", "Rechts", "Links", "Kopf", "Fuß"], sides: "RLVHKF",
      show: "Liste zeigen oder verbergen", opacity: "Deckkraft", explode: "Auseinanderziehen", map: "Karte", plain: "Einfarbig", without: "kein Wert",
      failed: "Dieser Browser kann kein 3D zeigen (WebGL 2)." },
    zh: { cut: "剖切", none: "不剖切", x: "从左到右", y: "从后到前", z: "从足到头", flip: "另一侧", all: "全部", nothing: "无",
      picture: "图片", light: "亮 / 暗", open: "开放", fit: "适合窗口", views: ["前", "后", "右", "左", "头", "足"],
      sides: "右左前后头足", show: "显示或隐藏列表", opacity: "不透明度", explode: "分开", map: "图", plain: "单色", without: "无值",
      failed: "此浏览器无法显示三维（WebGL 2）。" },
  };
  const language = (navigator.language || "en").slice(0, 2);
  const W = WORDS[language] || WORDS.en;
  document.documentElement.lang = WORDS[language] ? language : "en";
  const element = (name, parent, properties = {}) => {
    const made = Object.assign(document.createElement(name), properties);
    if (parent) parent.append(made);
    return made;
  };

  // Meshes and maps as packed.py writes them.
  const NONE = 65535;
  function unpacked(source) {
    const raw = atob(source.textContent.trim()), bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    source.textContent = "";
    return T.unzlibSync(bytes);
  }
  // Hands on each level of `count` that begin at `low`, with their high bytes at `high`.
  function eachLevel(all, count, low, high, take) {
    let level = 0;
    for (let i = 0; i < count; i++) {
      const code = all[low + i] | (all[high + i] << 8);
      level = (level + (code & 1 ? -((code + 1) >> 1) : code >> 1)) & 65535;
      take(i, level);
    }
  }
  function valuesOf(facts, all) {
    const values = new Float32Array(all.length / 2);
    eachLevel(all, values.length, 0, values.length, (i, level) => {
      values[i] = level === NONE ? NaN : facts.low + facts.step * level;
    });
    return values;
  }
  function geometryOf(facts, all) {
    const count = facts.vertices, corners = 3 * facts.faces;
    const positions = new Float32Array(3 * count);
    for (let axis = 0; axis < 3; axis++) {
      eachLevel(all, count, axis * count, (3 + axis) * count, (i, level) => {
        positions[3 * i + axis] = facts.low[axis] + facts.step[axis] * level;
      });
    }
    const indices = new Uint32Array(corners);
    let named = 0;
    for (let i = 0; i < corners; i++) {
      let code = 0;
      for (let plane = 0; plane < facts.planes; plane++) {
        code += all[6 * count + plane * corners + i] * 256 ** plane;
      }
      indices[i] = named - code;
      if (code === 0) named++;
    }
    const geometry = new T.BufferGeometry();
    geometry.setAttribute("position", new T.BufferAttribute(positions, 3));
    geometry.setIndex(new T.BufferAttribute(indices, 1));
    geometry.computeVertexNormals();
    geometry.computeBoundingBox();
    return geometry;
  }

  const canvas = document.getElementById("view");
  let renderer;
  try {
    renderer = new T.WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
  } catch (error) {
    Object.assign(document.getElementById("message"), { textContent: W.failed, hidden: false });
    return;
  }
  renderer.localClippingEnabled = true;
  renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
  renderer.toneMapping = T.NeutralToneMapping;

  const scene = new T.Scene(), group = new T.Group(), plane = new T.Plane(new T.Vector3(0, 0, -1), 0);
  scene.add(group);
  const structures = [];
  for (const source of document.querySelectorAll("script.structure")) {
    const facts = JSON.parse(source.dataset.facts), geometry = geometryOf(facts, unpacked(source));
    const material = new T.MeshStandardMaterial({ color: facts.color, roughness: 0.42, metalness: 0 });
    // Glass is denser at its rim than in its middle.
    material.onBeforeCompile = (shader) => {
      MAPS.colorByMap(shader);
      shader.fragmentShader = shader.fragmentShader.replace("#include <opaque_fragment>",
        "if (diffuseColor.a < 0.995) diffuseColor.a = mix(diffuseColor.a, 1.0, 0.75 * pow(1.0 - abs(normal.z), 2.5));\n" +
        "#include <opaque_fragment>");
    };
    // What a cut shows of a closed structure: its inner side in one color, as if it were filled.
    const filling = new T.MeshBasicMaterial({ color: new T.Color(facts.color).multiplyScalar(0.82), side: T.BackSide,
      toneMapped: false });
    const mesh = new T.Mesh(geometry, material), filled = new T.Mesh(geometry, filling);
    const size = geometry.boundingBox.getSize(new T.Vector3());
    mesh.renderOrder = size.length(); // what is inside is drawn before what is around it
    filled.visible = false;
    group.add(mesh, filled);
    structures.push({ facts, mesh, filled, shown: true, opacity: facts.opacity, maps: Object.create(null) });
  }
  const maps = Object.create(null); // by their names; those of one name have one range and ramp in all structures
  for (const source of document.querySelectorAll("script.map")) {
    const facts = JSON.parse(source.dataset.facts);
    structures[facts.structure].maps[facts.name] = valuesOf(facts, unpacked(source));
    maps[facts.name] = facts;
  }
  // Moved apart from their common center; `center` and `radius` are of what is shown when the view is fitted.
  const exploding = document.querySelector("script.explode");
  const exploded = exploding ? JSON.parse(exploding.dataset.facts) : { start: 0, most: 0, away: [] };
  const box = new T.Box3(), center = new T.Vector3();
  let radius = 1;
  function explode(mm) {
    exploded.mm = mm;
    box.makeEmpty();
    structures.forEach(({ mesh, filled }, at) => {
      if (exploding) mesh.position.fromArray(exploded.away[at]).multiplyScalar(mm);
      filled.position.copy(mesh.position);
      box.union(mesh.geometry.boundingBox.clone().translate(mesh.position));
    });
  }
  function measure() {
    box.getCenter(center);
    radius = Math.max(1, 0.5 * box.getSize(new T.Vector3()).length());
  }
  explode(exploded.start);
  measure();

  const camera = new T.OrthographicCamera(-1, 1, 1, -1, -100 * radius, 100 * radius);
  camera.up.set(0, 0, 1);
  const key = new T.DirectionalLight(0xffffff, 2.1), fill = new T.DirectionalLight(0xdfe8ff, 0.8);
  key.position.set(-0.6, 0.8, 1);
  fill.position.set(1, -0.3, 0.6);
  for (const light of [key, fill]) camera.add(light, light.target);
  scene.add(camera, new T.HemisphereLight(0xffffff, 0x9a938a, 1.1));
  const controls = new T.OrbitControls(camera, canvas);
  controls.enableDamping = false;
  controls.minZoom = 0.2;
  controls.maxZoom = 60;

  let waiting = false;
  const redraw = () => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; draw(); });
  };
  controls.addEventListener("change", redraw);

  const panel = document.getElementById("panel");
  const ways = [[0, 1, 0], [0, -1, 0], [1, 0, 0], [-1, 0, 0], [0, 0.001, 1], [0, 0.001, -1]];
  function lookFrom(way) {
    measure();
    controls.target.copy(center);
    camera.position.copy(center).addScaledVector(new T.Vector3(...way).normalize(), 4 * radius);
    camera.zoom = 1;
    resize();
    controls.update();
    redraw();
  }

  function resize() {
    const width = window.innerWidth, height = window.innerHeight, closed = panel.classList.contains("closed");
    const narrow = width <= 640, free = narrow || closed ? 0 : 312;
    renderer.setSize(width, height, false);
    // The list covers a part of the page: the structures are fitted beside it, or above it.
    const beside = width - free, above = narrow ? (closed ? height - 60 : 0.5 * height) : height;
    const unit = (1.9 * radius) / Math.max(1, Math.min(beside, above)); // mm of a pixel
    camera.left = (-(free + beside / 2)) * unit;
    camera.right = (beside / 2) * unit;
    camera.top = (above / 2) * unit;
    camera.bottom = (above / 2 - height) * unit;
    camera.updateProjectionMatrix();
    redraw();
  }
  window.addEventListener("resize", resize);

  const bar = document.querySelector("#scale div"), barText = document.querySelector("#scale span");
  const sides = document.querySelectorAll("#sides span");
  function draw() {
    renderer.render(scene, camera);
    const unit = (camera.top - camera.bottom) / camera.zoom / window.innerHeight;
    const most = 140 * unit, ten = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].map((step) => step * ten).find((step) => step <= most);
    bar.style.width = `${length / unit}px`;
    barText.textContent = length >= 10 ? `${length / 10} cm` : MAPS.lengthText(length, 1);
    const matrix = camera.matrixWorld.elements;
    const letters = (x, y, z) => [[x, 0], [y, 2], [z, 4]].filter(([share]) => Math.abs(share) > 0.35)
      .sort((a, b) => Math.abs(b[0]) - Math.abs(a[0])).map(([share, at]) => W.sides[at + (share < 0)]).join("");
    const [rx, ry, rz, , ux, uy, uz] = matrix;
    sides[0].textContent = letters(rx, ry, rz);
    sides[1].textContent = letters(-rx, -ry, -rz);
    sides[2].textContent = letters(ux, uy, uz);
    sides[3].textContent = letters(-ux, -uy, -uz);
  }

  // What is shown, how dense, and cut where.
  const cut = { axis: "", share: 0.5, side: 1 };
  function apply() {
    const axis = ["x", "y", "z"].indexOf(cut.axis), planes = axis < 0 ? [] : [plane];
    if (axis >= 0) {
      const normal = [0, 0, 0];
      normal[axis] = -cut.side;
      const low = box.min.getComponent(axis), high = box.max.getComponent(axis);
      plane.normal.set(...normal);
      plane.constant = cut.side * (low + cut.share * (high - low));
    }
    for (const [number, { facts, mesh, filled, shown, opacity }] of structures.entries()) {
      const glassy = opacity < 0.995, material = mesh.material;
      // Neighbors share their walls: of two that coincide one is drawn behind, glass behind what is not.
      const polygonOffsetUnits = (glassy ? 64 : 1) + 2 * number;
      Object.assign(material, { opacity, polygonOffset: true, polygonOffsetFactor: 0.5, polygonOffsetUnits });
      material.clippingPlanes = filled.material.clippingPlanes = planes;
      const fills = axis >= 0 && !glassy && facts.volume !== null;
      const side = fills ? T.FrontSide : T.DoubleSide;
      if (material.transparent !== glassy || material.side !== side) {
        Object.assign(material, { transparent: glassy, depthWrite: !glassy, side, needsUpdate: true });
      }
      mesh.visible = shown && opacity > 0;
      filled.visible = mesh.visible && fills;
    }
    redraw();
  }

  // The map that is shown: its colors, legend, and the value under the mouse.
  let map = null;
  const legend = document.getElementById("legend"), note = document.getElementById("value");
  function showMap(name) {
    map = maps[name] || null;
    if (map) MAPS.setRamp(map);
    for (const { mesh, maps: own } of structures) {
      const values = map && own[name];
      if (values) {
        mesh.geometry.setAttribute("mapShare", new T.BufferAttribute(MAPS.sharesOf(values, map.range), 2));
      } else mesh.geometry.deleteAttribute("mapShare");
      Object.assign(mesh.material, { defines: { STANDARD: "", ...(values && { SHOW_MAP: "" }) }, needsUpdate: true });
    }
    legend.hidden = !map;
    note.hidden = true;
    if (map) {
      const { unit, range: [low, high], colors, none } = map, bar = legend.querySelector("div i");
      const [shown, size] = MAPS.fitting(Math.max(Math.abs(low), Math.abs(high)), unit);
      legend.querySelector("b").textContent = MAPS.titleOf(name, unit, shown);
      bar.style.background = `linear-gradient(to top, ${colors.map((code) => `#${code}`).join(", ")})`;
      const ticks = [0, 0.25, 0.5, 0.75, 1].map((share) => {
        const tick = element("li", null, { textContent: MAPS.numberText(size * (low + share * (high - low))) });
        tick.style.bottom = `${100 * share}%`;
        return tick;
      });
      legend.querySelector("ol").replaceChildren(...ticks);
      legend.querySelector("p i").style.background = `#${none}`;
      legend.querySelector("p span").textContent = W.without;
    }
    redraw();
  }
  const valueAt = (x, y) => (map ? MAPS.valueAt(x, y, map.name, structures, camera, cut.axis ? plane : null) : null);
  let mouse = null;
  function showValue(event) {
    const idle = mouse === null;
    mouse = event;
    if (idle) requestAnimationFrame(() => {
      const { clientX: x, clientY: y, buttons, type } = mouse, turning = buttons && type === "pointermove";
      const value = turning ? null : valueAt(x, y);
      mouse = null;
      note.hidden = value === null;
      if (value === null) return;
      const [unit, size] = MAPS.fitting(Math.abs(value), map.unit);
      note.textContent = Number.isNaN(value) ? W.without : `${MAPS.numberText(size * value)} ${unit}`.trim();
      note.style.left = `${Math.min(x + 14, window.innerWidth - note.offsetWidth - 4)}px`;
      note.style.top = `${Math.max(4, y - 30)}px`;
    });
  }
  for (const kind of ["pointermove", "pointerdown"]) canvas.addEventListener(kind, showValue);
  canvas.addEventListener("pointerleave", () => { note.hidden = true; });

  const head = element("header", panel);
  element("b", head, { textContent: document.title, title: document.title });
  const body = element("div", panel, { className: "body" });
  element("button", head, { textContent: "◐", title: W.light, ariaLabel: W.light,
    onclick: () => document.documentElement.classList.toggle("dark") });
  element("button", head, { textContent: "☰", title: W.show, ariaLabel: W.show,
    onclick: () => { panel.classList.toggle("closed"); resize(); } });
  const views = element("div", body, { className: "tools" });
  ways.forEach((way, at) => element("button", views, { textContent: W.views[at], onclick: () => lookFrom(way) }));
  const list = element("div", body, { className: "list" }), rows = [];
  structures.forEach((structure, at) => {
    const { facts } = structure, row = element("div", list, { className: "row" });
    const eye = element("input", row, { type: "checkbox", checked: true, id: `s${at}` });
    element("i", row).style.background = facts.color;
    element("label", row, { textContent: facts.name, title: facts.name, htmlFor: eye.id });
    element("output", row, { textContent: facts.volume ?? W.open });
    const density = element("input", row, { type: "range", min: 0, max: 1, step: 0.01, value: facts.opacity,
      title: W.opacity, ariaLabel: `${W.opacity}: ${facts.name}` });
    const show = (shown) => {
      structure.shown = eye.checked = shown;
      row.classList.toggle("off", !shown);
    };
    eye.onchange = () => { show(eye.checked); apply(); };
    density.oninput = () => { structure.opacity = +density.value; apply(); };
    rows.push(show);
  });
  if (Object.keys(maps).length) {
    const choosing = element("div", body, { className: "tools" });
    const choice = element("select", choosing, { ariaLabel: W.map, id: "map" });
    element("option", choice, { value: "", textContent: W.plain });
    for (const { name, unit } of Object.values(maps)) {
      element("option", choice, { value: `=${name}`, textContent: MAPS.titleOf(name, unit) });
    }
    choice.onchange = () => showMap(choice.value.slice(1));
    const first = structures.find(({ facts }) => facts.shown);
    if (first) {
      choice.value = `=${first.facts.shown}`;
      showMap(first.facts.shown);
    }
  }
  const tools = element("div", body, { className: "tools" });
  element("button", tools, { textContent: W.all, onclick: () => { rows.forEach((show) => show(true)); apply(); } });
  element("button", tools, { textContent: W.nothing, onclick: () => { rows.forEach((show) => show(false)); apply(); } });
  element("button", tools, { textContent: W.fit, onclick: () => lookFrom([-0.4, 1, 0.2]) });
  element("button", tools, { textContent: W.picture, onclick: () => {
    draw();
    element("a", null, { href: canvas.toDataURL("image/png"), download: `${document.title}.png` }).click();
  } });
  const cutting = element("div", body, { className: "tools" });
  const which = element("select", cutting, { ariaLabel: W.cut, id: "cut" });
  for (const axis of ["", "x", "y", "z"]) {
    element("option", which, { value: axis, textContent: axis ? `${W.cut}: ${W[axis]}` : W.none });
  }
  element("button", cutting, { textContent: W.flip, onclick: () => { cut.side = -cut.side; apply(); } });
  const where = element("input", cutting, { type: "range", min: 0, max: 1, step: 0.002, value: 0.5, id: "where",
    ariaLabel: W.cut });
  if (exploding) {
    const moving = element("label", body, { className: "tools", textContent: W.explode });
    const away = element("input", moving, { type: "range", min: 0, max: exploded.most, step: exploded.most / 200,
      value: exploded.start, id: "explode" });
    const reads = element("output", moving);
    const tell = () => { reads.textContent = MAPS.lengthText(exploded.mm, 3); };
    away.oninput = () => { explode(+away.value); tell(); apply(); };
    tell();
  }
  which.onchange = () => { cut.axis = which.value; apply(); };
  where.oninput = () => { cut.share = +where.value; apply(); };
  if (window.innerWidth <= 640 && structures.length > 4) panel.classList.add("closed");

  apply();
  lookFrom([-0.4, 1, 0.2]);
  window.CTMC = { structures, camera, controls, cut, exploded, explode, apply, draw, lookFrom, maps, showMap, valueAt };
})();
