// SPDX-License-Identifier: GPL-3.0-or-later
// Maps of a page: their names, colors, and the value where a ray meets a surface. `viewer.js` uses it.
const MAPS = (() => {
  const numberText = (value) => String(+value.toPrecision(4));

  // The unit in which numbers up to the largest are shown, and how many of it a millimeter is; as core/measures/units.py chooses.
  const fitting = (largest, unit) => (unit === "mm" && largest && largest < 0.1 ? ["um", 1000] : [unit, 1]);
  const lengthText = (mm, digits) => {
    const [unit, size] = fitting(mm, "mm");
    return `${+(mm * size).toPrecision(digits)} ${unit}`;
  };

  // thickness_mm in mm is "thickness (mm)".
  function titleOf(name, unit, shown = unit) {
    const ending = `_${unit.toLowerCase()}`;
    const words = unit && name.toLowerCase().endsWith(ending) ? name.slice(0, -ending.length) : name;
    return words.replaceAll("_", " ") + (shown ? ` (${shown})` : "");
  }

  const linearOf = (level) => (level <= 0.04045 * 255 ? level / 255 / 12.92 : ((level / 255 + 0.055) / 1.055) ** 2.4);

  // What a shader needs: the ramp in linear steps, and for each vertex its share of the range and 1, or 0 and 0 for no
  // value. Values are interpolated, and colored afterwards, so that large triangles have the ramp's colors.
  const STEPS = 64, ramp = { value: new Float32Array(3 * (STEPS + 1)) }, none = { value: new Float32Array(3) };
  function setRamp({ colors, none: code }) {
    const parts = (color) => [0, 2, 4].map((at) => parseInt(color.slice(at, at + 2), 16));
    const stops = colors.map(parts), last = stops.length - 1;
    none.value.set(parts(code).map(linearOf));
    for (let i = 0; i <= STEPS; i++) {
      const along = (i / STEPS) * last, at = Math.min(Math.floor(along), last - 1), share = along - at;
      ramp.value.set(stops[at].map((low, c) => linearOf(low + share * (stops[at + 1][c] - low))), 3 * i);
    }
  }
  function sharesOf(values, [low, high]) {
    const out = new Float32Array(2 * values.length);
    values.forEach((value, i) => {
      if (!Number.isNaN(value)) out.set([(value - low) / (high - low || 1), 1], 2 * i);
    });
    return out;
  }
  function colorByMap(shader) {
    Object.assign(shader.uniforms, { mapRamp: ramp, mapNone: none });
    const head = "#ifdef SHOW_MAP\nvarying vec2 vMap;\n";
    shader.vertexShader = head + "attribute vec2 mapShare;\n#endif\n" + shader.vertexShader.replace(
      "#include <begin_vertex>", "#include <begin_vertex>\n#ifdef SHOW_MAP\nvMap = mapShare;\n#endif");
    shader.fragmentShader = head + `uniform vec3 mapRamp[${STEPS + 1}];\nuniform vec3 mapNone;\n#endif\n`
      + shader.fragmentShader.replace("#include <color_fragment>", `#include <color_fragment>
        #ifdef SHOW_MAP
        float along = clamp(vMap.x / max(vMap.y, 1e-6), 0.0, 1.0) * ${STEPS}.0;
        int at = int(min(along, ${STEPS - 1}.0));
        diffuseColor.rgb = vMap.y < 0.5 ? mapNone : mix(mapRamp[at], mapRamp[at + 1], along - float(at));
        #endif`);
  }

  // Calls `meet` with the corners, their shares and twice the area on the page of each triangle that a ray meets. Rays
  // go along `view`, the camera's matrix, through a point of space: no tree is needed, since a million triangles take
  // about 10 ms.
  function eachMeeting(geometry, [px, py, pz], view, meet) {
    const [rx, ry, rz, , ux, uy, uz] = view;
    const positions = geometry.attributes.position.array, corners = geometry.index.array;
    const count = positions.length / 3, across = new Float32Array(count), up = new Float32Array(count);
    for (let i = 0, at = 0; i < count; i++, at += 3) {
      const dx = positions[at] - px, dy = positions[at + 1] - py, dz = positions[at + 2] - pz;
      across[i] = dx * rx + dy * ry + dz * rz;
      up[i] = dx * ux + dy * uy + dz * uz;
    }
    for (let at = 0; at < corners.length; at += 3) {
      const i = corners[at], j = corners[at + 1], k = corners[at + 2];
      const first = across[j] * up[k] - across[k] * up[j], second = across[k] * up[i] - across[i] * up[k];
      const third = across[i] * up[j] - across[j] * up[i], area = first + second + third;
      const meets = area > 0 ? first >= 0 && second >= 0 && third >= 0 : first <= 0 && second <= 0 && third <= 0;
      if (meets && area) meet([i, j, k], [first / area, second / area, third / area], area);
    }
  }

  // The value of a map where a point of the page, in CSS pixels, meets a surface: NaN for no value, null where it meets
  // no surface of the map first. One looks through glass without the map.
  function valueAt(x, y, name, structures, camera, cut) {
    camera.updateMatrixWorld();
    const view = camera.matrixWorld.elements;
    const wide = (camera.right - camera.left) / 2 / camera.zoom, high = (camera.top - camera.bottom) / 2 / camera.zoom;
    const u = (camera.right + camera.left) / 2 + wide * (2 * x / window.innerWidth - 1);
    const v = (camera.top + camera.bottom) / 2 + high * (1 - 2 * y / window.innerHeight);
    const seen = [0, 1, 2].map((axis) => view[12 + axis] + u * view[axis] + v * view[4 + axis]);
    let nearest = -Infinity, value = null;
    for (const { mesh, filled, opacity, maps } of structures) {
      const values = maps[name], positions = mesh.geometry.attributes.position.array;
      const away = mesh.position.toArray(), through = seen.map((part, axis) => part - away[axis]);
      if (!mesh.visible || (!values && opacity < 0.995)) continue;
      eachMeeting(mesh.geometry, through, view, (ends, shares, area) => {
        const mean = (of) => shares.reduce((sum, share, at) => sum + share * of(ends[at]), 0);
        const point = [0, 1, 2].map((axis) => mean((end) => positions[3 * end + axis]));
        const depth = [0, 1, 2].reduce((sum, axis) => sum + view[8 + axis] * (point[axis] - through[axis]), 0);
        if (depth <= nearest) return;
        if (cut && cut.normal.toArray().reduce((sum, part, axis) => sum + part * (point[axis] + away[axis]),
          cut.constant) < 0) return;
        nearest = depth;
        const known = values ? mean((end) => (Number.isNaN(values[end]) ? 0 : 1)) : 0;
        // Where a cut fills a structure, its inside is seen, and no surface.
        if (!values || (area < 0 && filled.visible)) value = null;
        else value = known < 0.5 ? NaN : mean((end) => values[end] || 0) / known;
      });
    }
    return value;
  }

  return { fitting, lengthText, numberText, titleOf, setRamp, sharesOf, colorByMap, valueAt };
})();
