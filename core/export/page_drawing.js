"use strict";
const { texts, scene } = JSON.parse(document.getElementById("scene").textContent);
const stage = document.querySelector("main"), overlay = document.querySelector("svg"), home = scene.camera, view = { ...home };
const MOST_PIXELS = 4e6, SLOW = 45, FAST = 24, REST = 250; // px, ms a frame, ms, ms without a hand until the finest picture
const TAP = 300, REACH = 20; // ms and px between the two taps of a double tap
const NEEDED = ["DecompressionStream", "Response", "ResizeObserver", "PointerEvent"];
let canvas, gl, parts = {}, look = scene.variants[0], decoded = new Map(), programs, scale = 1, last = 0, waiting = false, resting = 0;

function full(value) { return typeof value === "string" ? value : texts[value.text]; }

async function bytes(text) {
  const packed = Uint8Array.from(atob(full(text)), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Planes of whole numbers, each the difference from its neighbour on the left: floats, channel by channel of a pixel.
async function planes({ width, height, scales, data }) {
  const found = new Int16Array((await bytes(data)).buffer), area = width * height, count = scales.length;
  const values = new Float32Array(area * count);
  for (let plane = 0, at = 0; plane < count; ++plane)
    for (let row = 0; row < height; ++row)
      for (let column = 0, sum = 0; column < width; ++column, ++at) {
        sum = (sum + found[at]) << 16 >> 16;
        values[(at - plane * area) * count + plane] = sum / scales[plane];
      }
  return values;
}

async function picture(source) {
  const image = new Image();
  image.src = full(source);
  await image.decode();
  return image;
}

async function decode({ channels, detail }) {
  const levels = async ({ image, weight }) => ({ image: await picture(image), weight: await bytes(weight) });
  const photo = async ({ mirrored, surface, ...fine }) => ({
    fine: await levels(fine), surface: await planes(surface),
    mirrored: mirrored && await levels(mirrored),
  });
  const [distance, photos, darkness, ...rgba] = await Promise.all([
    bytes(scene.distance), Promise.all((detail ? detail.photos : []).map(photo)),
    scene.shadow && bytes(scene.shadow.darkness), ...scene.variants[0].channels.map(bytes),
    ...(channels === scene.variants[0].channels ? [] : channels.map(bytes)), // what differs from the first variant
  ]);
  const texels = new Uint8Array(4 * rgba[0].length);
  for (const [index, plane] of rgba.entries())
    for (let at = 0; at < plane.length; ++at) texels[4 * at + index % 4] += plane[at]; // modulo 256
  return { texels, distance, photos, darkness };
}

function texture(target, filter) {
  gl.activeTexture(gl.TEXTURE0 + texture.count++);
  const made = gl.createTexture();
  texture.made.push(made);
  gl.bindTexture(target, made);
  for (const axis of ["S", "T", "R"]) gl.texParameteri(target, gl["TEXTURE_WRAP_" + axis], gl.CLAMP_TO_EDGE);
  gl.texParameteri(target, gl.TEXTURE_MAG_FILTER, filter);
  gl.texParameteri(target, gl.TEXTURE_MIN_FILTER, filter);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  return made;
}

function refuse(log) {
  throw new Error("the graphics driver refuses the drawing program (" + String(log).trim().split("\n")[0] + ")");
}

function program(sources) {
  const key = full(sources.fragment);
  if (!programs.has(key)) programs.set(key, compiled(sources));
  return programs.get(key);
}

function compiled(sources) {
  const made = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, sources.vertex], [gl.FRAGMENT_SHADER, sources.fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, full(source));
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) refuse(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) refuse(gl.getProgramInfoLog(made));
  const uniforms = {};
  for (let index = gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); index--;) {
    const { name, type } = gl.getActiveUniform(made, index), key = name.replace("[0]", "");
    uniforms[key] = { type, place: gl.getUniformLocation(made, name) };
  }
  return { made, uniforms };
}

function set({ uniforms }, values) {
  for (const [name, value] of Object.entries(values)) {
    if (!(name in uniforms)) continue;
    const { type, place } = uniforms[name], many = [value].flat(2);
    if (type === gl.FLOAT) gl.uniform1fv(place, many);
    else if (type === gl.FLOAT_VEC2) gl.uniform2fv(place, many);
    else if (type === gl.FLOAT_VEC3) gl.uniform3fv(place, many);
    else if (type === gl.FLOAT_MAT3) gl.uniformMatrix3fv(place, false, many);
    else gl.uniform1iv(place, many);
  }
}

// The photo's colours go from the image to the texture: read back from a canvas, browsers that protect privacy change them.
function colour(fine, image) {
  const copy = program(scene.copy), source = gl.createTexture();
  gl.useProgram(copy.made);
  set(copy, { image: texture.count });
  gl.activeTexture(gl.TEXTURE0 + texture.count);
  gl.bindTexture(gl.TEXTURE_2D, source);
  gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, image);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  const frame = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, fine, 0);
  gl.viewport(0, 0, image.width, image.height);
  gl.colorMask(true, true, true, false);
  gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  gl.colorMask(true, true, true, true);
  gl.deleteFramebuffer(frame);
  gl.deleteTexture(source);
}

function upload({ texels, distance, photos, darkness }) {
  const { uniforms, detail } = look, { shadow } = scene, units = {}, [x, y, z] = uniforms.sides, cells = uniforms.blocks;
  for (const made of texture.made || []) gl.deleteTexture(made);
  texture.made = [];
  texture.count = 0;
  units.texels = texture.count;
  texture(gl.TEXTURE_3D, gl.LINEAR);
  gl.texImage3D(gl.TEXTURE_3D, 0, gl.RGBA8, z, y, x, 0, gl.RGBA, gl.UNSIGNED_BYTE, texels);
  units.distance = texture.count;
  texture(gl.TEXTURE_3D, gl.NEAREST);
  gl.texImage3D(gl.TEXTURE_3D, 0, gl.R8UI, cells, cells, cells, 0, gl.RED_INTEGER, gl.UNSIGNED_BYTE, distance);
  for (const [number, maps] of photos.entries()) {
    const { width, height, levels, ...photo } = detail.photos[number];
    const levelled = ({ image, weight }) => {
      const weights = new Uint8Array(4 * weight.length);
      for (let at = 0; at < weight.length; ++at) weights[4 * at + 3] = weight[at];
      const unit = texture.count, fine = texture(gl.TEXTURE_2D, gl.LINEAR);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, weights);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAX_LEVEL, levels - 1);
      colour(fine, image);
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_NEAREST);
      gl.generateMipmap(gl.TEXTURE_2D);
      return unit;
    };
    const plain = (map, { width, height }) => {
      const unit = texture.count;
      texture(gl.TEXTURE_2D, gl.LINEAR);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA16F, width, height, 0, gl.RGBA, gl.FLOAT, map);
      return unit;
    };
    const fine = units["fine" + number] = levelled(maps.fine), { mirrored, surface } = maps; // the photo is mirrored, too
    units["mirrored" + number] = mirrored ? levelled(mirrored) : fine;
    units["surface" + number] = plain(surface, photo.surface);
  }
  const object = program(look.program);
  gl.useProgram(object.made);
  for (const [name, { type }] of Object.entries(object.uniforms)) // of photos that there are not: any texture of the type
    if (type === gl.SAMPLER_2D && !(name in units)) units[name] = units.fine0;
  set(object, { ...uniforms, ...units, ...(detail ? detail.uniforms : {}), tiles: [1, 1] });
  gl.vertexAttrib4f(gl.getAttribLocation(object.made, "tile"), 0, 0, 0, 1e6);
  if (!shadow) return { object };
  units.darkness = texture.count;
  texture(gl.TEXTURE_2D, gl.LINEAR);
  const [rows, columns] = shadow.size;
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.R8, columns, rows, 0, gl.RED, gl.UNSIGNED_BYTE, darkness);
  const ground = program(scene.ground);
  gl.useProgram(ground.made);
  set(ground, { ...shadow.uniforms, darkness: units.darkness });
  return { object, ground };
}

function draw(zoom) {
  if (document.body.dataset.state !== "turns") return;
  const { clientWidth: across, clientHeight: down } = stage;
  const ratio = Math.min(zoom * devicePixelRatio, Math.sqrt(MOST_PIXELS / (across * down)));
  const [width, height] = [across, down].map((side) => Math.max(1, Math.round(side * ratio)));
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const [sa, ca, se, ce] = [Math.sin(view.azimuth), Math.cos(view.azimuth), Math.sin(view.elevation), Math.cos(view.elevation)];
  const backward = [ce * ca, ce * sa, se], focal = view.focal * Math.min(width, height);
  const seen = {
    origin: backward.map((part) => part * view.distance),
    right: [-sa, ca, 0],
    up: [se * ca, se * sa, -ce], // turned round: the shader counts rows from above, a canvas from below
    backward,
    focal,
    middle: [width / 2, height / 2],
    size: [width, height],
    level: look.detail ? look.detail.photos.map(({ fineness, levels }) =>
      Math.min(levels - 1, Math.max(0, Math.round(Math.log2(fineness * view.distance / focal))))) : 0,
  };
  // The object's own space, which the scene stretches.
  const own = Object.fromEntries(["origin", "right", "up", "backward"].map((name) =>
    [name, seen[name].map((part, axis) => part / scene.proportions[axis])]));
  if (scene.dimensions && !overlay.hasAttribute("hidden")) drawDimensions(seen, across, down);
  gl.viewport(0, 0, width, height);
  gl.clearColor(0, 0, 0, 0);
  gl.clear(gl.COLOR_BUFFER_BIT);
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  for (const part of [parts.ground, parts.object]) {
    if (!part || (part === parts.ground && seen.origin[2] <= scene.shadow.uniforms.height)) continue;
    gl.useProgram(part.made);
    set(part, part === parts.ground ? seen : { ...seen, ...own });
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }
}

function refine() {
  clearTimeout(resting);
  resting = setTimeout(() => draw(scale < 1 ? 1 : 2), REST);
}

// While a hand moves the object, as many pixels as are drawn in time; more than the screen has once it rests.
function move() {
  refine();
  if (waiting) return;
  waiting = true;
  requestAnimationFrame((now) => {
    waiting = false;
    const took = now - last;
    last = now;
    if (took > SLOW && took < 1000) scale = Math.max(0.2, 0.8 * scale);
    else if (took < FAST) scale = Math.min(1, 1.1 * scale);
    draw(scale);
  });
}

// A browser takes the context of a page in the background, or of the oldest of many. Some never give it back.
function wake() {
  if (document.body.dataset.state === "paused" && !document.hidden) begin();
}

function begin() {
  if (canvas) canvas.remove();
  const mine = canvas = document.createElement("canvas");
  stage.insertBefore(mine, overlay);
  show("loading", "");
  mine.addEventListener("webglcontextlost", (event) => {
    event.preventDefault();
    if (mine === canvas) show("paused", "The browser paused the drawing. Tap to turn it.");
  });
  mine.addEventListener("webglcontextrestored", () => { if (mine === canvas) { programs = new Map(); texture.made = []; start(); } });
  programs = new Map();
  texture.made = [];
  gl = mine.getContext("webgl2", { alpha: true, premultipliedAlpha: true, antialias: false });
  start();
}

async function start() {
  const mine = gl;
  try {
    const missing = NEEDED.find((name) => !(name in window));
    if (missing || !mine) throw new Error("this browser has no " + (missing || "WebGL 2"));
    const wanted = look;
    if (!decoded.has(look)) decoded.set(look, decode(look));
    const values = await decoded.get(look);
    if (mine !== gl || mine.isContextLost() || wanted !== look) return;
    parts = upload(values);
    const error = mine.getError();
    if (error) throw new Error("the graphics card fails (error " + error + ")");
    const touch = matchMedia("(pointer: coarse)").matches;
    if (document.body.dataset.state !== "turns") show("turns", "drag to turn · " + (touch ? "pinch to zoom · double tap: home" : "wheel to zoom · double click: home"));
    draw(1);
    refine();
  } catch (error) {
    if (mine === gl && !(mine && mine.isContextLost())) still(error.message);
  }
}
