"use strict";
// Spectra of a mosaic's cells, shown where one clicks. All data lie in the page: nothing is loaded.
(() => {
  const data = JSON.parse(document.getElementById("spectra-data").textContent);
  const canvas = document.getElementById("spectra-map");
  const chart = document.getElementById("spectra-chart");
  const words = document.getElementById("spectra-words");
  const [rows, columns, bands] = data.shape;
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const numbers = (text) => new Uint16Array(bytes(text).buffer);
  const value = numbers(data.value);
  const spread = bytes(data.spread);
  const truth = data.truth ? numbers(data.truth) : null;
  const decoded = (q) => (q ? data.low + ((q - 1) / 65534) * (data.high - data.low) : NaN);
  const decodedSpread = (q) => (q ? data.most * ((q - 1) / 254) ** 2 : NaN);
  const at = { row: Math.floor(rows / 2), column: Math.floor(columns / 2) };
  const image = new Image();

  function spectrum() {
    const first = (at.row * columns + at.column) * bands;
    return data.wavelengths.map((w, k) => ({
      w,
      y: decoded(value[first + k]),
      sd: decodedSpread(spread[first + k]),
      true: truth ? decoded(truth[first + k]) : NaN,
    }));
  }

  function drawMap() {
    const c = canvas.getContext("2d");
    c.clearRect(0, 0, canvas.width, canvas.height);
    c.drawImage(image, 0, 0, canvas.width, canvas.height);
    const wide = (canvas.width * data.cell) / data.size[0];
    const high = (canvas.height * data.cell) / data.size[1];
    c.lineWidth = 2;
    c.font = "bold 13px sans-serif";
    for (const place of data.places) {
      const x = (place.x / data.size[0]) * canvas.width;
      const y = (1 - place.y / data.size[1]) * canvas.height;
      c.strokeStyle = "#fff";
      c.strokeRect(x - 2, y - 2, 4, 4);
      c.strokeStyle = "#000";
      c.strokeText(place.name, x + 6, y - 4);
      c.fillStyle = "#fff";
      c.fillText(place.name, x + 6, y - 4);
    }
    c.strokeStyle = "#000";
    c.lineWidth = 4;
    c.strokeRect(at.column * wide, at.row * high, wide, high);
    c.strokeStyle = "#ffd400";
    c.lineWidth = 2;
    c.strokeRect(at.column * wide, at.row * high, wide, high);
  }

  function ticks(low, high, count) {
    const raw = (high - low) / count;
    const power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 2.5, 5, 10].map((n) => n * power).find((n) => n >= raw);
    const found = [];
    for (let x = Math.ceil(low / step) * step; x <= high + 1e-9 * step; x += step) found.push(x);
    return found;
  }

  // Runs of bands for which a test holds, as [first, last].
  function runs(list, test) {
    const found = [];
    list.forEach((one, k) => {
      if (!test(one)) return;
      if (found.length && found[found.length - 1][1] === k - 1) found[found.length - 1][1] = k;
      else found.push([k, k]);
    });
    return found;
  }

  function drawChart(list) {
    const W = 640, H = 320, left = 64, right = 12, top = 12, bottom = 42;
    const w0 = data.wavelengths[0], w1 = data.wavelengths[bands - 1];
    const shown = list.filter((p) => p.w >= 400 && p.w <= 700).length ? list.filter((p) => p.w >= 400 && p.w <= 700) : list;
    const tops = shown.map((p) => p.y + (p.sd || 0)).concat(list.map((p) => p.true)).filter(Number.isFinite);
    const high = 1.12 * Math.max(...tops, 1e-9), low = Math.min(0, ...shown.map((p) => p.y).filter(Number.isFinite));
    const x = (w) => left + ((w - w0) / (w1 - w0)) * (W - left - right);
    const y = (v) => top + (1 - (Math.min(Math.max(v, low), high) - low) / (high - low)) * (H - top - bottom);
    const half = (k, side) => {
      const next = data.wavelengths[k + side];
      return next === undefined ? data.wavelengths[k] : 0.5 * (data.wavelengths[k] + next);
    };
    const path = (name) =>
      runs(list, (p) => Number.isFinite(p[name]))
        .map(([a, b]) => "M" + list.slice(a, b + 1).map((p) => `${x(p.w).toFixed(1)},${y(p[name]).toFixed(1)}`).join("L"))
        .join("");
    const masked = runs(list, (p) => !Number.isFinite(p.y));
    const bits = [];
    for (const [a, b] of masked) {
      const from = x(half(a, -1)), to = x(half(b, 1));
      bits.push(`<rect class="masked" x="${from}" y="${top}" width="${to - from}" height="${H - top - bottom}"/>`);
    }
    for (const v of ticks(low, high, 5)) {
      bits.push(`<line class="grid" x1="${left}" x2="${W - right}" y1="${y(v)}" y2="${y(v)}"/>`);
      bits.push(`<text x="${left - 6}" y="${y(v) + 4}" text-anchor="end">${+v.toPrecision(3)}</text>`);
    }
    for (const w of ticks(w0, w1, 8)) bits.push(`<text x="${x(w)}" y="${H - bottom + 17}" text-anchor="middle">${w}</text>`);
    bits.push(`<text x="${(left + W) / 2}" y="${H - 6}" text-anchor="middle">Wavelength [nm]</text>`);
    bits.push(`<text transform="translate(14 ${H / 2 - 14}) rotate(-90)" text-anchor="middle">${data.quantity}</text>`);
    for (const [a, b] of runs(list, (p) => Number.isFinite(p.y))) {
      const part = list.slice(a, b + 1);
      const up = part.map((p) => `${x(p.w).toFixed(1)},${y(p.y + (p.sd || 0)).toFixed(1)}`);
      const down = part.map((p) => `${x(p.w).toFixed(1)},${y(p.y - (p.sd || 0)).toFixed(1)}`).reverse();
      bits.push(`<polygon class="band" points="${up.concat(down).join(" ")}"/>`);
    }
    bits.push(`<path class="value" d="${path("y")}"/>`);
    if (truth) bits.push(`<path class="truth" d="${path("true")}"/>`);
    chart.setAttribute("viewBox", `0 0 ${W} ${H}`);
    chart.innerHTML = bits.join("");
    return masked.map(([a, b]) => `${data.wavelengths[a].toFixed(0)}–${data.wavelengths[b].toFixed(0)} nm`);
  }

  function show() {
    const list = spectrum();
    const seen = list.some((p) => Number.isFinite(p.y));
    const masked = drawChart(list);
    drawMap();
    const x = (at.column + 0.5) * data.cell, y = data.size[1] - (at.row + 0.5) * data.cell;
    const [n, e] = data.to_place.map((row) => row[0] + row[1] * x + row[2] * y);
    const where = `north ${n.toFixed(2)} m, east ${e.toFixed(2)} m of the datum; x ${(data.left + x).toFixed(2)}, y ${(data.bottom + y).toFixed(2)} (${data.crs})`;
    words.textContent = seen
      ? `${where}. ${masked.length ? `Masked (grey): ${masked.join(", ")}.` : "No band is masked."}`
      : `${where}. Not seen.`;
    for (const button of document.querySelectorAll("#spectra-places button")) {
      const place = data.places[button.dataset.place];
      const inside = Math.floor(place.x / data.cell) === at.column && Math.floor((data.size[1] - place.y) / data.cell) === at.row;
      button.setAttribute("aria-pressed", String(inside));
    }
  }

  function go(row, column) {
    at.row = Math.min(Math.max(row, 0), rows - 1);
    at.column = Math.min(Math.max(column, 0), columns - 1);
    show();
  }

  function point(event) {
    const box = canvas.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * data.size[0];
    const y = ((event.clientY - box.top) / box.height) * data.size[1];
    go(Math.floor(y / data.cell), Math.floor(x / data.cell));
  }

  const goTo = (place) => go(Math.floor((data.size[1] - place.y) / data.cell), Math.floor(place.x / data.cell));
  canvas.addEventListener("click", point);
  canvas.addEventListener("pointermove", (event) => event.pointerType === "mouse" && event.buttons === 1 && point(event));
  canvas.addEventListener("keydown", (event) => {
    const step = event.shiftKey ? 10 : 1;
    const way = { ArrowUp: [-step, 0], ArrowDown: [step, 0], ArrowLeft: [0, -step], ArrowRight: [0, step] }[event.key];
    if (!way) return;
    event.preventDefault();
    go(at.row + way[0], at.column + way[1]);
  });
  const buttons = document.getElementById("spectra-places");
  data.places.forEach((place, k) => {
    const button = document.createElement("button");
    button.type = "button";
    button.dataset.place = k;
    button.textContent = place.name;
    button.addEventListener("click", () => goTo(place));
    buttons.append(button);
  });
  image.onload = () => (data.places.length ? goTo(data.places[0]) : show());
  image.src = data.picture;
})();
