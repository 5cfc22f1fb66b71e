// SPDX-License-Identifier: GPL-3.0-or-later
// Maps of a page: their names, colors, and the value where a ray meets a surface. `viewer.js` uses it.
const MAPS = (() => {
  const numberText = (value) => String(+value.toPrecision(4));

  // thickness_mm in mm is "thickness (mm)".
  function titleOf(name, unit) {
    const ending = `_${unit.toLowerCase()}`;
    const words = unit && name.toLowerCase().endsWith(ending) ? name.slice(0, -ending.length) : name;
    return words.replaceAll("_", " ") + (unit ? ` (${unit})` : "");
  }

  const linearOf = (level) => (level <= 0.04045 * 255 ? level / 255 / 12.92 : ((level / 255 + 0.055) / 1.055) ** 2.4);

  // The linear color of every value, as core/maps/ramps.py has it.
  function colorsOf(values, { range: [low, high], colors, none }) {
    const stops = [...colors, none].map((code) => [0, 2, 4].map((at) => parseInt(code.slice(at, at + 2), 16)));
    const linear = Float32Array.from({ length: 256 }, (_, level) => linearOf(level));
    const out = new Float32Array(3 * values.length), last = colors.length - 1;
    for (let i = 0; i < values.length; i++) {
      const known = !Number.isNaN(values[i]);
      const along = known ? last * Math.min(1, Math.max(0, (values[i] - low) / (high - low || 1))) : last + 1;
      const at = Math.floor(along), share = along - at, next = Math.min(at + 1, known ? last : at);
      for (let c = 0; c < 3; c++) {
        out[3 * i + c] = linear[Math.round(stops[at][c] + share * (stops[next][c] - stops[at][c]))];
      }
    }
    return out;
  }

  // Calls `meet` with the corners, their shares and twice the area on the page of each triangle that a ray meets. Rays
  // go along `view`, the camera's matrix, through a point of space: no tree is needed, since a million triangles take
  // some milliseconds.
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
    const through = [0, 1, 2].map((axis) => view[12 + axis] + u * view[axis] + v * view[4 + axis]);
    let nearest = -Infinity, value = null;
    for (const { mesh, filled, opacity, maps } of structures) {
      const values = maps[name], positions = mesh.geometry.attributes.position.array;
      if (!mesh.visible || (!values && opacity < 0.995)) continue;
      eachMeeting(mesh.geometry, through, view, (ends, shares, area) => {
        const mean = (of) => shares.reduce((sum, share, at) => sum + share * of(ends[at]), 0);
        const point = [0, 1, 2].map((axis) => mean((end) => positions[3 * end + axis]));
        const depth = [0, 1, 2].reduce((sum, axis) => sum + view[8 + axis] * (point[axis] - through[axis]), 0);
        if (depth <= nearest) return;
        if (cut && cut.normal.toArray().reduce((sum, part, axis) => sum + part * point[axis], cut.constant) < 0) return;
        nearest = depth;
        const unknown = values && ends.some((end) => Number.isNaN(values[end]));
        // Where a cut fills a structure, its inside is seen, and no surface.
        if (!values || (area < 0 && filled.visible)) value = null;
        else if (unknown) value = values[ends[shares.indexOf(Math.max(...shares))]];
        else value = mean((end) => values[end]);
      });
    }
    return value;
  }

  return { numberText, titleOf, colorsOf, valueAt };
})();
