// The camera image and what is drawn over it; clicks and drags on it. Places are in pixels of the filter's image.

export const COLORS = ["#ff4d4d", "#4da3ff", "#ffb84d", "#c77dff", "#39d98a", "#ff7ac6", "#00c2c7", "#d4d45a"];
const GRAB = 14; // CSS px around a point or a target that count as a hit; more for a finger
const GRAB_TOUCH = 26;
const TRAIL = 240; // places

export const colorOf = (number) => COLORS[(number - 1) % COLORS.length];

export class Picture {
  constructor(ask, onChoose) {
    this.ask = ask;
    this.onChoose = onChoose;
    this.picture = document.getElementById("picture");
    this.marks = document.getElementById("marks");
    this.state = null;
    this.frame = 0;
    this.tool = "point";
    this.chosen = null;
    this.showTrails = true;
    this.trails = new Map();
    this.drag = null;
    this.steers = false; // by the latest state, which may be newer than the image
    this.sent = 0;
    this.marks.addEventListener("pointerdown", (event) => this.down(event));
    this.marks.addEventListener("pointermove", (event) => this.move(event));
    this.marks.addEventListener("pointerup", (event) => this.up(event));
    this.marks.addEventListener("pointercancel", () => (this.drag = null));
    this.marks.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  show(bitmap, state) {
    if (this.picture.width !== bitmap.width || this.picture.height !== bitmap.height) {
      this.picture.width = bitmap.width;
      this.picture.height = bitmap.height;
    }
    this.picture.getContext("2d").drawImage(bitmap, 0, 0);
    this.frame = state.frame;
    this.picture.dataset.frame = state.frame;
    this.state = state;
    for (const point of state.points) {
      const trail = this.trails.get(point.number) ?? [];
      trail.push(point.at);
      if (trail.length > TRAIL) trail.shift();
      this.trails.set(point.number, trail);
    }
    const present = new Set(state.points.map((point) => point.number));
    for (const number of this.trails.keys()) if (!present.has(number)) this.trails.delete(number);
    if (this.chosen !== null && !present.has(this.chosen)) this.choose(null);
    // A point that was just added is the chosen one, so that the next click gives it its target.
    const newest = Math.max(0, ...present);
    if (this.expecting && newest > this.expecting.after) {
      this.expecting = null;
      this.choose(newest);
    }
    this.draw();
  }

  choose(number) {
    this.chosen = number;
    this.onChoose(number);
  }

  scale() {
    return this.marks.clientWidth / this.state.size[0];
  }

  place(event) {
    const box = this.marks.getBoundingClientRect();
    const [width, height] = this.state.size;
    // Pixel centers are whole numbers: the image's left edge is at -0.5.
    const x = ((event.clientX - box.left) / box.width) * width - 0.5;
    const y = ((event.clientY - box.top) / box.height) * height - 0.5;
    return [Math.min(Math.max(x, 0), width - 1), Math.min(Math.max(y, 0), height - 1)];
  }

  hit(event) {
    const reach = (event.pointerType === "touch" ? GRAB_TOUCH : GRAB) / this.scale();
    const [x, y] = this.place(event);
    let best = null;
    for (const point of this.state.points) {
      for (const [kind, at] of [["target", point.target], ["point", point.at]]) {
        const distance = at ? Math.hypot(at[0] - x, at[1] - y) : Infinity;
        if (distance < reach && (!best || distance < best.distance)) best = { point: point.number, kind, distance };
      }
    }
    return best;
  }

  down(event) {
    if (!this.state || !this.steers || event.button > 0) return;
    this.marks.setPointerCapture(event.pointerId);
    this.drag = { from: this.place(event), to: this.place(event), hit: this.hit(event), moved: false, start: [event.clientX, event.clientY], frame: this.frame };
  }

  move(event) {
    const drag = this.drag;
    if (!drag) return;
    drag.to = this.place(event);
    drag.moved ||= Math.hypot(event.clientX - drag.start[0], event.clientY - drag.start[1]) > 6;
    if (this.tool === "point" && drag.hit && drag.moved) {
      this.choose(drag.hit.point);
      const now = performance.now();
      if (now - this.sent > 50) this.aim(drag.hit.point, drag.to, now);
    }
    this.draw();
  }

  up(event) {
    const drag = this.drag;
    this.drag = null;
    if (!drag) return;
    drag.to = this.place(event);
    if (this.tool === "object") {
      if (drag.moved) this.ask({ do: "object", from: drag.from, to: drag.to });
    } else if (drag.hit && drag.moved) {
      this.aim(drag.hit.point, drag.to, 0);
    } else if (drag.hit && drag.hit.kind === "point" && drag.hit.point !== this.chosen) {
      this.choose(drag.hit.point);
    } else if (this.chosen !== null && !event.shiftKey) {
      this.aim(this.chosen, drag.to, 0);
      this.choose(null); // the next click is a new point
    } else {
      this.expecting = { after: Math.max(0, ...this.state.points.map((point) => point.number)) };
      this.ask({ do: "point", at: drag.from, frame: drag.frame });
    }
    this.draw();
  }

  aim(point, target, now) {
    this.sent = now;
    this.ask({ do: "aim", point, target, go: true });
  }

  draw() {
    const canvas = this.marks;
    const ratio = window.devicePixelRatio || 1;
    const width = Math.round(canvas.clientWidth * ratio);
    const height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const c = canvas.getContext("2d");
    c.clearRect(0, 0, width, height);
    if (!this.state) return;
    const scale = this.scale() * ratio;
    const at = (place) => [(place[0] + 0.5) * scale, (place[1] + 0.5) * scale];
    c.lineWidth = 2 * ratio;
    for (const point of this.state.points) this.drawPoint(c, point, at, ratio);
    this.drawObject(c, at, scale, ratio);
    if (this.drag && this.tool === "object") {
      const [x, y] = at(this.drag.from);
      const [right, bottom] = at(this.drag.to);
      c.strokeStyle = "#fff";
      c.setLineDash([6 * ratio, 4 * ratio]);
      c.strokeRect(x, y, right - x, bottom - y);
      c.setLineDash([]);
    }
  }

  drawPoint(c, point, at, ratio) {
    const color = colorOf(point.number);
    const [x, y] = at(point.at);
    if (this.showTrails) {
      c.strokeStyle = color;
      c.globalAlpha = 0.6;
      c.beginPath();
      for (const place of this.trails.get(point.number) ?? []) c.lineTo(...at(place));
      c.stroke();
      c.globalAlpha = 1;
    }
    if (point.target) {
      const [tx, ty] = at(point.target);
      c.strokeStyle = color;
      c.setLineDash([3 * ratio, 5 * ratio]);
      c.beginPath();
      c.moveTo(x, y);
      c.lineTo(tx, ty);
      c.stroke();
      c.setLineDash([]);
      this.stroke(c, color, ratio, () => {
        const r = 7 * ratio;
        c.moveTo(tx - r, ty - r);
        c.lineTo(tx + r, ty + r);
        c.moveTo(tx + r, ty - r);
        c.lineTo(tx - r, ty + r);
      });
    }
    const ring = point.state === "lost" ? "#aaa" : color;
    if (point.state === "uncertain") c.setLineDash([3 * ratio, 3 * ratio]);
    this.stroke(c, ring, ratio, () => c.arc(x, y, (point.number === this.chosen ? 10 : 7) * ratio, 0, 7));
    c.setLineDash([]);
    this.stroke(c, ring, ratio, () => c.arc(x, y, 1 * ratio, 0, 7));
    c.font = `bold ${13 * ratio}px system-ui`;
    c.lineWidth = 3 * ratio;
    c.strokeStyle = "#000";
    c.fillStyle = "#fff";
    c.strokeText(point.number, x + 11 * ratio, y - 8 * ratio);
    c.fillText(point.number, x + 11 * ratio, y - 8 * ratio);
    c.lineWidth = 2 * ratio;
  }

  drawObject(c, at, scale, ratio) {
    const known = this.state.object;
    if (!known || !known.box) return;
    const [x, y] = at([known.box[0] - 0.5, known.box[1] - 0.5]);
    c.strokeStyle = "#fff";
    c.strokeRect(x, y, known.box[2] * scale, known.box[3] * scale);
    this.stroke(c, "#fff", ratio, () => c.arc(...at(known.at), 4 * ratio, 0, 7));
  }

  // With a dark rim, to be seen on any image.
  stroke(c, color, ratio, path) {
    for (const [style, wide] of [["#000", 4], [color, 2]]) {
      c.strokeStyle = style;
      c.lineWidth = wide * ratio;
      c.beginPath();
      path();
      c.stroke();
    }
  }
}
