// The page: buttons and keys to messages, the session's state to what is shown.

import { Connection } from "./connection.js";
import { JointTable, LogList, PointList } from "./panels.js";
import { Picture } from "./picture.js";
import { Plots } from "./plots.js";

const $ = (id) => document.getElementById(id);
const joints = new JointTable();
const log = new LogList();
const plots = new Plots();
const ask = (message) => connection.send(message);
const picture = new Picture(ask, () => refresh());
const points = new PointList(ask, (number) => picture.choose(number));
let latest = null;
let shown = [];
let chosen = {}; // by setting: the number of the message that last chose it here

const connection = new Connection(onState, onImage, onBreak);

function onState(state) {
  latest = { ...latest, ...state };
  if (state.hello) {
    chosen = {};
    log.reset();
    plots.reset(state.plots);
    look();
  }
  log.show(state.lines);
  if (state.joints) {
    joints.show(state.joints);
    plots.add(state);
  }
  refresh();
}

function onImage(bitmap, state) {
  picture.show(bitmap, { ...latest, ...state });
  const now = performance.now();
  shown.push(now);
  shown = shown.filter((time) => now - time < 2000);
  $("rate").textContent = `${(shown.length / 2).toFixed(0)} images/s`;
}

function onBreak() {
  connection.held = false;
  latest = latest && { ...latest, control: "free", open: false };
  banner("The connection is lost: the robot was told to stop. Trying again.", true);
  $("mode").textContent = "disconnected";
  $("mode").className = "badge bad";
  enable(false);
}

function refresh() {
  if (!latest) return;
  const steers = latest.control === "yours";
  $("source").textContent = latest.source;
  $("mode").textContent = latest.mode;
  $("mode").className = `badge ${latest.mode}`;
  const others = latest.pages > 1 ? `${latest.pages} pages` : "";
  $("control").textContent = [others, { yours: "you steer", taken: "you watch", free: "nobody steers" }[latest.control]].filter(Boolean).join(", ");
  $("take").hidden = latest.control !== "free";
  $("leave").hidden = !steers || latest.pages < 2;
  if (latest.joints) {
    points.show(latest.points, picture.chosen, steers);
    $("go").disabled = !steers || latest.mode === "reaching" || !latest.points.some((point) => point.target);
    if (isHeard("speed")) $("speed").value = Math.log10(latest.speed);
    const units = { rad: `${latest.speed.toFixed(2)} rad/s`, m: `${latest.sliding_speed.toFixed(3)} m/s` };
    $("speed-value").textContent = Object.keys(units).filter((unit) => latest.joints.some((joint) => joint.unit === unit)).map((unit) => units[unit]).join(", ");
    if (isHeard("dead-man")) $("dead-man").checked = latest.dead_man;
    $("held").hidden = !latest.dead_man;
    $("record").textContent = latest.recording ? "Stop recording" : "Record";
    $("object-panel").hidden = !latest.object;
    $("body").hidden = latest.body !== "learning the body";
    if (latest.object) $("object-state").textContent = latest.object.state;
  }
  $("download").hidden = !latest.download;
  enable(steers && latest.mode !== "starting");
  offerLayers(latest.layers ?? []);
  say();
}

// A state that was sent before a choice arrived does not take it back.
const isHeard = (id) => latest.heard >= (chosen[id] ?? 0);

function enable(steers) {
  picture.steers = steers;
  for (const element of document.querySelectorAll(".steer")) if (element.id !== "go") element.disabled = !steers;
  if (!steers) $("go").disabled = true;
  const commands = latest?.commands !== false;
  for (const id of ["learn", "go", "center"]) $(id).disabled ||= !commands;
  for (const id of ["speed", "dead-man", "load"]) $(id).disabled = !steers;
  $("load-label").setAttribute("aria-disabled", String(!steers));
  $("chase").disabled ||= picture.chosen === null;
}

function say() {
  const stopped = latest.mode === "still" && latest.reason && !["learned", "J was forgotten"].includes(latest.reason);
  if (latest.mode === "starting") banner("Starting: the first time, kernels are compiled for up to half a minute.", false);
  else if (latest.faults?.length) banner(latest.faults.join("; "), true);
  else if (stopped) banner(`Stopped: ${latest.reason}`, true);
  else $("banner").hidden = true;
  const steps = latest.joints ? hint() : "Waiting for the camera.";
  $("hint").textContent = steps;
}

function hint() {
  if (latest.control === "taken") return "Another page steers; Stop works here too.";
  if (latest.control === "free") return "Nobody steers. Take control to move the robot.";
  if (picture.tool === "object") return "Drag a box around an object.";
  if (!latest.commands) return "A recording follows no commands; click points to follow them.";
  if (latest.mode === "learning") return learningHint();
  if (picture.chosen !== null) return `Click where point ${picture.chosen} should go, or drag it.`;
  if (latest.body === "learning the body") return "Learning the body: until then, points go by their own look.";
  const known = latest.joints.every((joint) => (joint.learned ?? 0) > 0.5);
  return known ? "Click a point of the robot." : "Press Learn first: the robot moves every joint a little. Clear the space around it.";
}

function learningHint() {
  const begun = "Learning: the robot moves at random and stops when J is good enough";
  const images = latest.body_images;
  return images ? `${begun} and the body has its images: ${images.have} of ${images.need}.` : `${begun}.`;
}

function banner(text, urgent) {
  $("banner").hidden = false;
  $("banner").textContent = text;
  $("banner").className = urgent ? "" : "calm";
}

function offerLayers(names) {
  const select = $("layer");
  if (select.options.length === names.length + 1) return;
  const before = select.value;
  select.replaceChildren(new Option("camera", ""), ...names.map((name) => new Option(name.replace("jacobian:", "J of "), name)));
  select.value = names.includes(before) ? before : "";
}

const look = () => ask({ do: "look", layer: $("layer").value, style: $("style").value });
const stop = (by) => ask({ do: "stop", by });

$("stop").addEventListener("pointerdown", () => stop("button"));
$("stop").addEventListener("click", () => stop("button"));
$("learn").addEventListener("click", () => ask({ do: "learn" }));
$("go").addEventListener("click", () => ask({ do: "go" }));
$("clear").addEventListener("click", () => ask({ do: "clear" }));
$("forget").addEventListener("click", () => ask({ do: "forget" }));
$("take").addEventListener("click", () => ask({ do: "take" }));
$("leave").addEventListener("click", () => ask({ do: "leave" }));
$("center").addEventListener("click", () => ask({ do: "center" }));
$("drop").addEventListener("click", () => ask({ do: "drop_object" }));
$("chase").addEventListener("click", () => ask({ do: "chase", point: picture.chosen }));
$("record").addEventListener("click", () => ask({ do: "record", on: !latest.recording }));
$("dead-man").addEventListener("change", (event) => {
  chosen["dead-man"] = ask({ do: "dead_man", on: event.target.checked });
});
$("speed").addEventListener("input", (event) => {
  chosen.speed = ask({ do: "speed", value: 10 ** Number(event.target.value) });
});
$("layer").addEventListener("change", look);
$("style").addEventListener("change", look);
$("trails").addEventListener("change", (event) => {
  picture.showTrails = event.target.checked;
  picture.draw();
});

for (const tool of ["point", "object"]) {
  $(`tool-${tool}`).addEventListener("click", () => {
    picture.tool = tool;
    for (const other of ["point", "object"]) {
      $(`tool-${other}`).classList.toggle("on", other === tool);
      $(`tool-${other}`).setAttribute("aria-pressed", String(other === tool));
    }
    refresh();
  });
}

$("load").addEventListener("change", async (event) => {
  const [file] = event.target.files;
  event.target.value = "";
  if (file) await fetch("state", { method: "POST", body: file, headers: { "Content-Type": "application/octet-stream" } });
});

function hold(down) {
  $("held").classList.toggle("down", down);
  connection.hold(down);
}
$("held").addEventListener("pointerdown", () => hold(true));
for (const name of ["pointerup", "pointerleave", "pointercancel"]) $("held").addEventListener(name, () => hold(false));

const typing = (element) => element.matches?.("input:not([type=range]):not([type=checkbox]), textarea");
window.addEventListener(
  "keydown",
  (event) => {
    if (event.code === "Space" || event.code === "Escape") {
      stop("key");
      if (!typing(event.target)) event.preventDefault(); // else Space would press the button that has the focus
    } else if (event.code === "KeyG" && !event.repeat) {
      hold(true);
    }
  },
  true,
);
window.addEventListener("keyup", (event) => {
  if (event.code === "Space") event.preventDefault();
  if (event.code === "KeyG") hold(false);
});
window.addEventListener("blur", () => hold(false));
document.addEventListener("visibilitychange", () => {
  if (document.hidden && latest?.control === "yours") stop("hidden");
});
