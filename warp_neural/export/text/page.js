"use strict";
// What a page does: a triangle over the canvas, whose fragments evaluate the network, drawn again when something moves.

const data = JSON.parse(document.getElementById("data").textContent);
const element = (id) => document.getElementById(id);
const canvas = element("picture");
const controls = [...document.querySelectorAll("[data-uniform]")];
const pointers = new Map();
const place = {};  // u, v in the middle of the canvas, and how much closer than at the start
const PATIENCE = 60;  // milliseconds a frame while something moves
let gl, program, coarse = 4, settling;
let busy = false, stale = false;  // a frame is on its way; something has moved since it began

function problem(text) {
    element("problem").textContent = text;
}

function linked(sources) {
    const result = gl.createProgram();
    const shaders = sources.map(([type, source]) => {
        const shader = gl.createShader(type);
        gl.shaderSource(shader, source);
        gl.compileShader(shader);
        gl.attachShader(result, shader);
        return shader;
    });
    gl.linkProgram(result);
    if (gl.getProgramParameter(result, gl.LINK_STATUS)) return result;
    const logs = [...shaders.map((shader) => gl.getShaderInfoLog(shader)), gl.getProgramInfoLog(result)];
    problem(`The graphics driver refuses the shader: ${logs.find((log) => log)}`);
}

function start() {
    const options = { alpha: false, antialias: false, depth: false, preserveDrawingBuffer: true };
    gl = canvas.getContext("webgl2", options);
    if (!gl) return problem("This browser or its graphics driver has no WebGL2, which the page needs.");
    program = linked([[gl.VERTEX_SHADER, data.vertex], [gl.FRAGMENT_SHADER, data.fragment]]);
    if (!program) return;
    gl.useProgram(program);
    if (!loadTextures(gl, program, data)) return problem("The graphics driver refuses the textures.");
    listen();
    reset();
}

function reset() {
    element("controls").reset();
    Object.assign(place, { u: data.start[0], v: data.start[1], closer: 1 });
    show();
}

// u and v a pixel of the page. Downwards v grows.
function steps() {
    const box = canvas.getBoundingClientRect(), step = Math.max(1 / box.height, data.aspect / box.width);
    return [step / place.closer / data.aspect, step / place.closer];
}

function pan(x, y) {
    const [du, dv] = steps();
    place.u += x * du;
    place.v = Math.min(Math.max(place.v + y * dv, data.lowest), data.highest);
    show();
}

// What lies at x, y, in pixels from the middle, stays there.
function zoom(factor, x, y) {
    const [du, dv] = steps();
    const closer = Math.min(Math.max(place.closer * factor, data.farthest), data.closest);
    const moved = data.pans ? 1 - place.closer / closer : 0;
    Object.assign(place, { closer, u: place.u + x * du * moved, v: place.v + y * dv * moved });
    show();
}

function show() {
    stale = true;
    canvas.setAttribute("aria-busy", true);
    if (!busy) requestAnimationFrame(() => draw(coarse));
    busy = true;
}

function valueOf(control) {
    if (control.type === "checkbox") return [control.checked ? 1 : 0];
    if (control.type !== "color") return [Number(control.value)];
    return [1, 3, 5].map((at) => parseInt(control.value.slice(at, at + 2), 16) / 255);
}

// Every `pixels`-th pixel of each row and column.
function draw(pixels) {
    clearTimeout(settling);
    [busy, stale] = [true, false];
    const began = performance.now(), box = canvas.getBoundingClientRect();
    const ratio = Math.min(devicePixelRatio, 2) / pixels;
    const width = Math.max(Math.round(box.width * ratio), 1), height = Math.max(Math.round(box.height * ratio), 1);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const [du, dv] = [(steps()[0] * box.width) / width, (steps()[1] * box.height) / height];
    const view = [place.u - (width / 2) * du, place.v + (height / 2) * dv, du, -dv];
    gl.viewport(0, 0, width, height);
    gl.uniform4fv(gl.getUniformLocation(program, "view"), view);
    gl.uniform2f(gl.getUniformLocation(program, "size"), width, height);
    for (const control of controls) {
        const value = valueOf(control), location = gl.getUniformLocation(program, control.dataset.uniform);
        if (value.length === 3) gl.uniform3fv(location, value);
        else gl.uniform1f(location, value[0]);
        const output = control.parentElement.querySelector("output");
        if (output) output.textContent = value[0].toFixed(control.dataset.digits ?? 2);
    }
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    canvas.dataset.view = view.join(" ");
    whenDone(gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0), () => drawn(performance.now() - began, pixels));
}

// Asks again and again without blocking: at first by messages, which come sooner than timers, but keep a core busy.
function whenDone(fence, act) {
    gl.flush();
    const { port1, port2 } = new MessageChannel(), began = performance.now();
    port1.onmessage = () => {
        if (gl.clientWaitSync(fence, 0, 0) === gl.TIMEOUT_EXPIRED) {
            if (performance.now() - began < 20) return port2.postMessage(0);
            return setTimeout(port1.onmessage, 4);
        }
        port1.close();
        gl.deleteSync(fence);
        act();
    };
    port2.postMessage(0);
}

// Slow machines see fewer pixels while something moves, and all of them soon after.
function drawn(milliseconds, pixels) {
    const first = element("first");
    busy = false;
    if (first.dataset.milliseconds) {
        const full = milliseconds * pixels * pixels;
        coarse = [1, 2, 4, 8].find((each) => full < PATIENCE * each * each) ?? 8;
        element("frame").textContent = `${milliseconds.toFixed(1)} ms`;
        element("frame").dataset.milliseconds = milliseconds;
        element("size").textContent = `${canvas.width} \u00d7 ${canvas.height}`;
    } else {  // its time is mostly the compiler's
        first.dataset.milliseconds = performance.now();
        first.textContent = `${performance.now().toFixed(0)} ms`;
    }
    if (stale) show();
    else if (pixels > 1) settling = setTimeout(() => draw(1), 150);
    else canvas.setAttribute("aria-busy", false);
}

function save() {
    canvas.toBlob((blob) => {
        const link = document.createElement("a");
        Object.assign(link, { href: URL.createObjectURL(blob), download: `${document.title}.png` }).click();
        URL.revokeObjectURL(link.href);
    });
}

function gesture() {
    const points = [...pointers.values()], [a, b] = points, sum = (name) => points.reduce((s, p) => s + p[name], 0);
    const spread = b ? Math.max(Math.hypot(a.x - b.x, a.y - b.y), 1) : 1;
    return { x: sum("x") / points.length, y: sum("y") / points.length, spread };
}

function pointOf(event) {
    const box = canvas.getBoundingClientRect();
    return { x: event.clientX - box.left - box.width / 2, y: event.clientY - box.top - box.height / 2 };
}

function moved(event) {
    if (!pointers.has(event.pointerId)) return;
    const before = gesture();
    pointers.set(event.pointerId, pointOf(event));
    const after = gesture();
    pan(before.x - after.x, before.y - after.y);
    zoom(after.spread / before.spread, after.x, after.y);
}

function pressed(event) {
    const keys = {
        ArrowLeft: () => pan(-32, 0), ArrowRight: () => pan(32, 0),
        ArrowUp: () => pan(0, -32), ArrowDown: () => pan(0, 32),
        "+": () => zoom(1.25, 0, 0), "=": () => zoom(1.25, 0, 0), "-": () => zoom(0.8, 0, 0), 0: reset, Home: reset,
    };
    if (!(event.key in keys) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    keys[event.key]();
}

function listen() {
    canvas.addEventListener("pointerdown", (event) => {
        canvas.setPointerCapture(event.pointerId);
        pointers.set(event.pointerId, pointOf(event));
    });
    canvas.addEventListener("pointermove", moved);
    for (const name of ["pointerup", "pointercancel"]) {
        canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
    }
    canvas.addEventListener("wheel", (event) => {
        event.preventDefault();
        const { x, y } = pointOf(event), pixels = event.deltaY * (event.deltaMode ? 30 : 1);
        zoom(Math.exp(-0.0015 * Math.min(Math.max(pixels, -400), 400)), x, y);
    }, { passive: false });
    canvas.addEventListener("keydown", pressed);
    canvas.addEventListener("webglcontextlost", () => problem("The graphics driver gave up; load the page again."));
    element("closer").addEventListener("click", () => zoom(1.25, 0, 0));
    element("farther").addEventListener("click", () => zoom(0.8, 0, 0));
    element("again").addEventListener("click", reset);
    element("save").addEventListener("click", save);
    element("controls").addEventListener("submit", (event) => event.preventDefault());
    element("controls").addEventListener("input", (event) => {
        const other = element(event.target.dataset.clears);
        if (other) other.checked = false;
        show();
    });
    new ResizeObserver(show).observe(canvas);
}

start();
