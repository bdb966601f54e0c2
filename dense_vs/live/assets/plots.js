// Two plots over the last two minutes: the largest error, and the share of the motion that J explains.

const SECONDS = 120;
const MOST = 900;

export class Plots {
  constructor() {
    this.rows = [];
    this.error = document.getElementById("plot-error");
    this.explained = document.getElementById("plot-explained");
  }

  reset(rows) {
    this.rows = rows;
  }

  add(state) {
    const last = this.rows.at(-1);
    if (state.time === undefined || state.time === null) return;
    if (last && state.time < last[0]) this.rows = [];
    if (last && state.time - last[0] < 0.2 && state.time >= last[0]) return;
    this.rows.push([state.time, state.error, state.explained]);
    if (this.rows.length > MOST) this.rows.shift();
    this.draw();
  }

  draw() {
    if (!this.rows.length) return;
    const errors = this.rows.map((row) => row[1]).filter((value) => value !== null);
    const most = Math.max(5, ...errors);
    curve(this.error, this.rows, 1, most, "error", "px", "#ff6b61");
    curve(this.explained, this.rows, 2, 1, "motion explained by J", "%", "#39b579");
  }
}

function curve(canvas, rows, column, top, title, unit, color) {
  const ratio = window.devicePixelRatio || 1;
  const width = Math.round(canvas.clientWidth * ratio);
  const height = Math.round(canvas.clientHeight * ratio);
  if (!width || !height) return;
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const c = canvas.getContext("2d");
  const style = getComputedStyle(document.body);
  const end = rows.at(-1)[0];
  const begin = Math.max(rows[0][0], end - SECONDS);
  const head = 18 * ratio;
  const x = (time) => ((time - begin) / Math.max(end - begin, 5)) * (width - 2 * ratio);
  const y = (value) => head + (1 - Math.max(0, Math.min(value / top, 1))) * (height - head - 2 * ratio);
  c.clearRect(0, 0, width, height);
  c.strokeStyle = style.color;
  c.globalAlpha = 0.2;
  c.lineWidth = ratio;
  for (const part of [0, 0.5, 1]) {
    c.beginPath();
    c.moveTo(0, y(part * top));
    c.lineTo(width, y(part * top));
    c.stroke();
  }
  c.globalAlpha = 1;
  c.strokeStyle = color;
  c.lineWidth = 2 * ratio;
  c.beginPath();
  let down = false;
  for (const row of rows) {
    if (row[0] < begin || row[column] === null) {
      down = false;
      continue;
    }
    if (down) c.lineTo(x(row[0]), y(row[column]));
    else c.moveTo(x(row[0]), y(row[column]));
    down = true;
  }
  c.stroke();
  const value = rows.at(-1)[column];
  const shown = value === null ? "–" : unit === "%" ? `${Math.round(100 * value)} %` : `${value.toFixed(1)} ${unit}`;
  c.fillStyle = style.color;
  c.font = `${12 * ratio}px system-ui`;
  c.textAlign = "left";
  c.fillText(`${title}: ${shown}`, 0, 12 * ratio);
  c.textAlign = "right";
  c.fillText(unit === "%" ? "100 %" : `${top.toFixed(0)} px`, width, 12 * ratio);
}
