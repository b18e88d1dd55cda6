// Draws the charts and the moving scene of a page that flexmb wrote; see html_page.py.
"use strict";
(function () {
  const data = JSON.parse(document.getElementById("data").textContent);
  const kinds = { f4: Float32Array, f8: Float64Array, i2: Int16Array, u1: Uint8Array, u4: Uint32Array };
  const ink = "#2b2f36", grid = "#e3e5e9";
  const font = { family: "system-ui, -apple-system, Segoe UI, Roboto, Arial, sans-serif", size: 13, color: ink };

  function unpack(packed) {
    const text = atob(packed.data), bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
    return new kinds[packed.kind](bytes.buffer);
  }
  // names of users are text, not the markup that plotly would make of it
  function plain(text) {
    return String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  }

  // ---- charts -------------------------------------------------------------------------------
  const timeCharts = [];
  function drawChart(chart) {
    const box = document.getElementById(chart.id);
    const axis = (label, log) => ({
      title: { text: plain(label), standoff: 8 }, gridcolor: grid, zerolinecolor: "#c9ccd2",
      linecolor: ink, ticks: "outside", tickcolor: "#c9ccd2", automargin: true,
      type: log ? "log" : "linear", exponentformat: "power", hoverformat: ".6g",
    });
    const traces = chart.lines.map((line) => ({
      type: "scatter", mode: chart.points ? "lines+markers" : "lines", name: plain(line.name),
      x: unpack(line.x), y: unpack(line.y), line: { color: line.color, width: 1.7, dash: line.dash },
      text: (line.words || []).map(plain), marker: { size: 8 },
      hovertemplate: chart.points ? "%{text}<br>%{x:.3g}, %{y:.3g}" : undefined,
    }));
    const layout = {
      font, margin: { l: 66, r: 14, t: 10 + 19 * chart.rows, b: 46 }, paper_bgcolor: "white", plot_bgcolor: "white",
      hovermode: chart.points ? "closest" : "x unified", showlegend: true,
      hoverlabel: { font: { size: 12 } },
      legend: { orientation: "h", x: 0, y: 1.02, xanchor: "left", yanchor: "bottom", font: { size: 12 } },
      xaxis: axis(chart.x, chart.logs), yaxis: axis(chart.y, chart.logs),
    };
    if (chart.equal) { layout.yaxis.scaleanchor = "x"; layout.hovermode = "closest"; }
    Plotly.newPlot(box, traces, layout, { responsive: true, displaylogo: false, displayModeBar: false });
    if (chart.time) {
      const cursor = document.createElement("div");
      cursor.className = "cursor";
      box.appendChild(cursor);
      timeCharts.push({ box, cursor, factor: chart.time });
      box.on("plotly_click", (event) => { if (seek) seek(event.points[0].x * chart.time); });
    }
  }
  function moveCursors(time) {
    for (const { box, cursor, factor } of timeCharts) {
      const layout = box._fullLayout;
      if (!layout) continue;
      const x = layout.xaxis.l2p(time / factor), inside = x >= 0 && x <= layout.xaxis._length;
      cursor.style.display = inside ? "block" : "none";
      cursor.style.left = layout.xaxis._offset + x + "px";
      cursor.style.top = layout.yaxis._offset + "px";
      cursor.style.height = layout.yaxis._length + "px";
    }
  }

  // ---- the moving scene ---------------------------------------------------------------------
  let seek = null;
  function openMotion(motion) {
    const stage = document.getElementById(motion.id);
    const play = document.getElementById("play"), slider = document.getElementById("frame");
    const clock = document.getElementById("clock"), factor = document.getElementById("factor");
    const [least, most] = motion.limits;
    const times = unpack(motion.times), frames = times.length;
    const meshes = motion.meshes.map((mesh) => {
      const parts = mesh.parts.map((part) => ({
        ...part, points: unpack(part.points), motion: part.motion && unpack(part.motion),
        shapes: part.shapes && unpack(part.shapes), amounts: part.amounts && unpack(part.amounts), values: part.values && unpack(part.values),
      }));
      const n = parts.reduce((sum, part) => sum + part.points.length / 3, 0);
      return { ...mesh, parts, n, corners: unpack(mesh.corners),
        x: new Float32Array(n), y: new Float32Array(n), z: new Float32Array(n), c: new Float32Array(n) };
    });

    // x = R (s + f u) + r: s the undeformed place, f the exaggeration of u, the sum of shared shapes
    function place(mesh, frame, f) {
      let at = 0;
      for (const part of mesh.parts) {
        const n = part.points.length / 3, m = part.motion, o = 12 * frame;
        const s = part.shapes ? bent(part, frame, part.flexible ? f : 1) : part.points;
        for (let i = 0; i < n; i++, at++) {
          const x = s[3 * i], y = s[3 * i + 1], z = s[3 * i + 2];
          if (m) {
            mesh.x[at] = m[o] * x + m[o + 1] * y + m[o + 2] * z + m[o + 9];
            mesh.y[at] = m[o + 3] * x + m[o + 4] * y + m[o + 5] * z + m[o + 10];
            mesh.z[at] = m[o + 6] * x + m[o + 7] * y + m[o + 8] * z + m[o + 11];
          } else { mesh.x[at] = x; mesh.y[at] = y; mesh.z[at] = z; }
          if (part.values) mesh.c[at] = least + (most - least) * part.values[n * frame + i] / 255;
        }
      }
    }
    function bent(part, frame, f) {
      const out = Float32Array.from(part.points), n = out.length, count = part.shapes.length / n;
      for (let k = 0; k < count; k++) {
        const amount = f * part.amounts[count * frame + k], o = n * k;
        for (let i = 0; i < n; i++) out[i] += amount * part.shapes[o + i];
      }
      return out;
    }
    function facets(mesh) {
      const n = mesh.corners.length / 3, ijk = [new Uint32Array(n), new Uint32Array(n), new Uint32Array(n)];
      for (let t = 0; t < n; t++) for (let k = 0; k < 3; k++) ijk[k][t] = mesh.corners[3 * t + k];
      return ijk;
    }
    const light = { lightposition: { x: motion.light[0], y: motion.light[1], z: motion.light[2] } };
    const digits = Math.max(0, Math.min(12, 3 - Math.ceil(Math.log10(times[frames - 1] - times[0] || 1))));
    const vector = (v) => ({ x: v[0], y: v[1], z: v[2] });
    const factorNow = () => (factor ? Number(factor.value) : 1);
    const traces = meshes.map((mesh) => {
      place(mesh, 0, factorNow());
      if (mesh.lines) {
        return { type: "scatter3d", mode: "lines", hoverinfo: "skip", ...lines(mesh),
          line: { width: 7, color: mesh.colored ? lineColors(mesh) : mesh.color, colorscale: "Viridis",
            cmin: least, cmax: most, showscale: mesh.colored && motion.bar, colorbar: bar() } };
      }
      const [i, j, k] = facets(mesh);
      const trace = { type: "mesh3d", x: mesh.x, y: mesh.y, z: mesh.z, i, j, k, opacity: mesh.opacity,
        flatshading: !mesh.colored, hoverinfo: "skip", ...light,
        lighting: { ambient: 0.65, diffuse: 0.6, specular: 0.08, roughness: 0.7, fresnel: 0.1, facenormalsepsilon: 0, vertexnormalsepsilon: 0 } };
      if (mesh.colored) {
        Object.assign(trace, { intensity: mesh.c, cmin: least, cmax: most, colorscale: "Viridis",
          showscale: motion.bar, colorbar: bar() });
      } else {
        const colors = [];
        for (const [color, count] of mesh.colors) for (let t = 0; t < count; t++) colors.push(color);
        trace.facecolor = colors;
      }
      return trace;
    });
    function bar() {
      const small = window.innerWidth < 600;
      return { title: { text: plain(motion.scale), side: small ? "top" : "right" }, thickness: 12, len: small ? 0.9 : 0.7,
        orientation: small ? "h" : "v", y: small ? -0.02 : 0.5, yanchor: small ? "top" : "middle",
        outlinewidth: 0, exponentformat: "power" };
    }
    function lines(mesh) {
      const at = mesh.corners, n = at.length / 2, x = [], y = [], z = [];
      for (let l = 0; l < n; l++) {
        for (const k of [at[2 * l], at[2 * l + 1]]) { x.push(mesh.x[k]); y.push(mesh.y[k]); z.push(mesh.z[k]); }
        x.push(null); y.push(null); z.push(null);
      }
      return { x, y, z };
    }
    function lineColors(mesh) {
      const at = mesh.corners, c = [];
      for (let l = 0; l < at.length / 2; l++) { c.push(mesh.c[at[2 * l]], mesh.c[at[2 * l + 1]], 0); }
      return c;
    }
    const [low, high] = motion.box, extent = high.map((v, a) => v - low[a]);
    const axis = (a) => ({ visible: false, range: [low[a], high[a]], autorange: false });
    // plotly's orthographic view is two units high, whatever the distance of the eye
    const shape = stage.clientWidth / stage.clientHeight;
    const reach = Math.max(motion.seen[1], motion.seen[0] / (shape * (motion.bar && shape > 1 ? 0.84 : 0.96)));
    const unit = 1.84 / reach;
    const middle = motion.center.map((v, a) => unit * (v - 0.5 * (low[a] + high[a])));
    const home = { eye: vector(motion.eye.map((v, a) => 2 * v + middle[a])), up: vector(motion.up),
      center: vector(middle), projection: { type: "orthographic" } };
    const layout = {
      font, margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "white", showlegend: false, uirevision: "stay",
      scene: { xaxis: axis(0), yaxis: axis(1), zaxis: axis(2), aspectmode: "manual", dragmode: "orbit",
        aspectratio: vector(extent.map((v) => unit * v)), camera: home },
    };
    const moving = meshes.map((mesh, k) => k).filter((k) => meshes[k].moves);
    let frame = 0, playing = false, held = false, busy = false, late = false, begun = 0, from = 0;

    function show(next) {
      frame = next;
      slider.value = frame;
      clock.textContent = `t = ${times[frame].toFixed(digits)} ${motion.unit}`;
      stage.dataset.frame = frame;
      moveCursors(times[frame]);
      late = busy;
      if (busy) return;
      busy = true;
      const update = { x: [], y: [], z: [] }, colors = [], at = [];
      for (const k of moving) {
        place(meshes[k], frame, factorNow());
        const own = meshes[k].lines ? lines(meshes[k]) : meshes[k];
        update.x.push(own.x); update.y.push(own.y); update.z.push(own.z);
        if (meshes[k].colored && !meshes[k].lines) { colors.push(meshes[k].c); at.push(k); }
      }
      let done = Promise.resolve();
      if (moving.length) done = Plotly.restyle(stage, update, moving);
      if (at.length) done = done.then(() => Plotly.restyle(stage, { intensity: colors }, at));
      const end = () => { busy = false; if (late) show(frame); };
      done.then(end, end);
    }
    function tick(now) {
      if (!playing) return;
      if (!held && !busy) {
        const next = Math.floor((from + (now - begun) / 1000 * motion.rate) % frames);
        if (next !== frame) show(next);
      }
      requestAnimationFrame(tick);
    }
    function start(on) {
      playing = on;
      play.textContent = on ? "❚❚ Pause" : "▶ Play";
      play.setAttribute("aria-pressed", on);
      if (on) { begun = performance.now(); from = frame; requestAnimationFrame(tick); }
    }
    Plotly.newPlot(stage, traces, layout, { responsive: true, displaylogo: false, displayModeBar: false, scrollZoom: true })
      .then(() => { stage.dataset.ready = "yes"; show(motion.first); },
        (error) => { stage.textContent = "The motion cannot be drawn: this browser has no WebGL."; console.warn(error); });
    play.addEventListener("click", () => start(!playing));
    slider.addEventListener("input", () => { start(false); show(Number(slider.value)); });
    if (factor) factor.addEventListener("change", () => show(frame));
    document.getElementById("home").addEventListener("click", () => Plotly.relayout(stage, { "scene.camera": home }));
    stage.addEventListener("pointerdown", () => { held = true; });
    window.addEventListener("pointerup", () => { if (held) { held = false; begun = performance.now(); from = frame; } });
    window.addEventListener("resize", () => setTimeout(() => moveCursors(times[frame]), 400));
    seek = (time) => {
      let best = 0;
      for (let k = 1; k < frames; k++) if (Math.abs(times[k] - time) < Math.abs(times[best] - time)) best = k;
      start(false); show(best);
    };
  }

  function begin() {
    if (data.motion) openMotion(data.motion);
    for (const chart of data.charts) drawChart(chart);
    document.body.dataset.ready = "yes";
  }
  // on paper a chart is as wide as the page
  function resize(width) {
    for (const box of document.querySelectorAll(".chart")) if (box._fullLayout) Plotly.relayout(box, { width });
  }
  window.addEventListener("beforeprint", () => resize(660));
  window.addEventListener("afterprint", () => resize(null));
  const started = performance.now();
  begin();
  document.body.dataset.milliseconds = Math.round(performance.now() - started);
})();
