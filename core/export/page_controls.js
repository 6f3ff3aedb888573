// The lines that dimensions.py draws on pictures. Units are hundredths of the shorter side.
function drawDimensions({ origin, right, up, backward }, across, down) {
  const { low, high, labels } = scene.dimensions, unit = Math.min(across, down) / 100;
  const dot = (a, b) => a.reduce((sum, value, axis) => sum + value * b[axis], 0);
  const project = (point) => {
    const away = point.map((value, axis) => value - origin[axis]), scale = -100 * view.focal / dot(away, backward);
    return [across / unit / 2 + scale * dot(away, right), down / unit / 2 + scale * dot(away, up)];
  };
  const between = ([a, b]) => a.map((value, axis) => (value + b[axis]) / 2), centre = between([low, high]);
  const near = low.map((value, axis) => (origin[axis] > centre[axis] ? high[axis] : value)), middle = project(centre);
  const far = low.map((value, axis) => value + high[axis] - near[axis]);
  const side = (...ends) => ends.map(([x, y, z]) => project([x, y, z]));
  const corner = [near[0], near[1], low[2]], ends = [[far[0], near[1], low[2]], [near[0], far[1], low[2]]];
  const uprights = [...ends, corner].map(([x, y, z]) => side([x, y, z], [x, y, high[2]]));
  const reach = uprights.map((upright, index) => (index < 2 ? 1 : 0.9) * Math.abs(between(upright)[0] - middle[0]));
  const upright = uprights[reach.indexOf(Math.max(...reach))];
  overlay.setAttribute("viewBox", [0, 0, across / unit, down / unit].join(" "));
  overlay.innerHTML = [side(ends[0], corner), side(corner, ends[1]), upright].map(([a, b], index) => {
    const line = [b[0] - a[0], b[1] - a[1]], length = Math.hypot(...line), [x, y] = between([a, b]);
    if (length < 8) return "";
    const turn = line[1] * (x - middle[0]) > line[0] * (y - middle[1]) ? 1 / length : -1 / length;
    const out = [turn * line[1], -turn * line[0]];
    const away = (point, by) => point.map((value, axis) => value + by * out[axis]);
    const strokes = [[away(a, 3), away(b, 3)], ...[a, b].map((end) => [away(end, 1), away(end, 4.2)])];
    const place = away([x, y], 4.2 + 0.9 * labels[index].length * Math.abs(out[0]) + 1.7 * Math.abs(out[1]));
    return `<path d="${strokes.map(([p, q]) => `M${p}L${q}`).join("")}"/><text x="${place[0]}" y="${place[1]}">${labels[index]}</text>`;
  }).join("");
}

function listen() {
  const fingers = new Map();
  let tap = { time: 0 };
  const turn = (across, up) => {
    for (const button of document.getElementsByName("View")) button.checked = false;
    view.azimuth -= across;
    view.elevation = Math.max(-1.55, Math.min(1.55, view.elevation + up));
    move();
  };
  const zoom = (factor) => {
    view.distance = Math.max(home.distance / 3, Math.min(3 * home.distance, view.distance * factor));
    move();
  };
  const goHome = () => { Object.assign(view, home); move(); };
  const spread = () => {
    const [one, other] = [...fingers.values()];
    return Math.hypot(one.x - other.x, one.y - other.y);
  };
  const on = (name, handler) => document.addEventListener(name, handler, { passive: false });
  on("pointerdown", (event) => {
    if (event.target.closest("nav")) return;
    wake();
    stage.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (document.body.dataset.state === "turns") document.getElementById("hint").style.visibility = "hidden";
  });
  on("pointermove", (event) => {
    const finger = fingers.get(event.pointerId);
    if (!finger) return;
    const before = fingers.size > 1 ? spread() : 0, [x, y] = [event.clientX - finger.x, event.clientY - finger.y];
    [finger.x, finger.y] = [event.clientX, event.clientY];
    const side = Math.min(stage.clientWidth, stage.clientHeight);
    if (fingers.size > 1) zoom(before / Math.max(1, spread()));
    else turn((4 * x) / side, (4 * y) / side);
  });
  on("pointerup", ({ timeStamp: time, clientX: x, clientY: y }) => { // not dblclick, which some phones never send
    const twice = fingers.size === 1 && time - tap.time < TAP && Math.hypot(x - tap.x, y - tap.y) < REACH;
    tap = { time: twice || fingers.size > 1 ? 0 : time, x, y };
    if (twice) goHome();
  });
  for (const end of ["pointerup", "pointercancel"]) on(end, (event) => fingers.delete(event.pointerId));
  for (const pinch of ["gesturestart", "touchmove"]) on(pinch, (event) => event.preventDefault()); // of the whole page
  on("wheel", (event) => {
    if (parent !== window && !document.hasFocus()) return; // in a frame, until a click, the page around it scrolls
    event.preventDefault();
    zoom(Math.exp(0.001 * event.deltaY));
  });
  on("keydown", (event) => {
    if (event.target.closest("nav")) return; // arrows go from button to button
    const steps = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
    const factors = { "+": 0.9, "=": 0.9, "-": 1.1 };
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    wake();
    if (event.key in steps) turn(...steps[event.key]);
    else if (event.key in factors) zoom(factors[event.key]);
    else if (event.key === "Home") goHome();
    else return;
    event.preventDefault();
  });
  on("visibilitychange", wake);
  new ResizeObserver(() => move()).observe(stage);
  followDensity();
}

function followDensity() { // of the screen, to which a window may be moved; each query asks for one density
  const density = matchMedia(`(resolution: ${devicePixelRatio}dppx)`);
  density.addEventListener("change", () => { move(); followDensity(); }, { once: true });
}

function fromAddress() { // #azimuth,elevation[,distance] in degrees and scene units
  const [azimuth, elevation, distance] = location.hash.slice(1).split(",").map(Number);
  if (!isFinite(azimuth) || !isFinite(elevation) || !location.hash) return;
  [view.azimuth, view.elevation] = [azimuth, elevation].map((angle) => angle * Math.PI / 180);
  if (distance > 0) view.distance = distance;
}

// A group of buttons of which one is pressed, or for type "checkbox" any; arrow keys go from one to the next.
function choices(title, entries, choose, type = "radio") {
  const group = document.createElement("fieldset");
  group.setAttribute("aria-label", title);
  for (const [index, { name, colour }] of entries.entries()) {
    const label = document.createElement("label"), button = document.createElement("input");
    Object.assign(button, { type, name: title });
    button.addEventListener("change", () => choose(index, button.checked));
    label.append(button);
    if (colour) label.append(Object.assign(document.createElement("i"), { style: `background: ${colour}` }));
    label.append(name);
    group.append(label);
  }
  document.querySelector("nav").append(group);
  return group;
}

function offerChoices() {
  const level = { ...home, elevation: 0.15 }, quarter = Math.PI / 2;
  const views = [["Front", quarter], ["Side", 0], ["Back", -quarter]].map(([name, azimuth]) => ({ name, ...level, azimuth }));
  views.push({ ...home, name: scene.first });
  choices("View", views, (index) => {
    const { name, ...seen } = views[index];
    Object.assign(view, seen);
    move();
  });
  if (scene.dimensions) {
    const size = choices("Size", [{ name: "Size" }], (_, shown) => { overlay.toggleAttribute("hidden", !shown); move(); }, "checkbox");
    size.querySelector("input").checked = true;
  }
  if (scene.variants.length < 2) return;
  const swatches = choices("Colour", scene.variants, (index) => { look = scene.variants[index]; start(); });
  swatches.querySelector("input").checked = true;
}

const BUTTON = `<svg xmlns="http://www.w3.org/2000/svg" width="122" height="26" font-family="system-ui, sans-serif">
<rect width="122" height="26" rx="13" fill="#2566b8"/><path d="M20 6l7 4v7l-7 4-7-4v-7zm0 8v7m0-7l7-4m-7 4l-7-4" fill="none"
stroke="#fff"/><text x="72" y="17.5" font-size="13" text-anchor="middle" fill="#fff">In your room</text></svg>`;

// Phones place the object in a room: iPhones read the file in this page, Android one beside it on the server.
async function offerRoom({ usdz, glb }) {
  const link = document.createElement("a"), picture = new Image(), hint = document.getElementById("hint");
  picture.src = "data:image/svg+xml," + encodeURIComponent(BUTTON);
  picture.alt = "See it in your room";
  link.append(picture); // and nothing else: iPhones require it
  document.querySelector("nav").append(link);
  const android = /android/i.test(navigator.userAgent), [file, page, name] =
    [new URL(glb, location), location, document.title].map((text) => encodeURIComponent(text));
  if (link.relList.supports && link.relList.supports("ar")) {
    link.rel = "ar";
    link.href = URL.createObjectURL(new Blob([await bytes(usdz)], { type: "model/vnd.usdz+zip" }));
  } else if (android && location.protocol === "https:") {
    link.href = `intent://arvr.google.com/scene-viewer/1.0?file=${file}&mode=ar_preferred&title=${name}#Intent;scheme=https;` +
      `package=com.google.android.googlequicksearchbox;action=android.intent.action.VIEW;S.browser_fallback_url=${page};end;`;
  } else {
    link.href = "#";
    link.addEventListener("click", (event) => {
      event.preventDefault();
      hint.style.visibility = "";
      hint.textContent = android ? `Put this page and ${glb} on a web server (https), and open it from there.`
        : "Open this page on an iPhone, or from a web server on an Android phone.";
    });
  }
}

offerChoices();
if (scene.room) offerRoom(scene.room);
fromAddress();
begin();
if (document.body.dataset.state !== "still") listen();
