// Joints, points and log lines as the page lists them.

import { colorOf } from "./picture.js";

const make = (name, className = "", text = "") => {
  const element = document.createElement(name);
  if (className) element.className = className;
  if (text) element.textContent = text;
  return element;
};

const number = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits));

export class JointTable {
  constructor() {
    this.body = document.querySelector("#joints tbody");
    this.rows = [];
  }

  show(joints) {
    if (this.rows.length !== joints.length) {
      this.body.replaceChildren();
      this.rows = joints.map((joint) => {
        const row = make("tr");
        const cells = ["name", "", "", "", ""].map((name) => row.appendChild(make("td", name)));
        cells[0].textContent = joint.name;
        cells[0].title = joint.name;
        const limit = cells[2].appendChild(make("div", "bar limit"));
        const learned = cells[4].appendChild(make("div", "bar"));
        this.body.append(row);
        return { cells, limit, place: limit.appendChild(make("i")), learned: learned.appendChild(make("i")), bar: learned };
      });
    }
    joints.forEach((joint, index) => {
      const row = this.rows[index];
      row.cells[1].textContent = `${number(joint.position, 3)} ${joint.unit}`;
      row.cells[3].textContent = number(joint.command, 4);
      const limited = joint.low !== null && joint.high !== null;
      row.limit.hidden = !limited;
      if (limited) {
        const part = Math.min(Math.max((joint.position - joint.low) / (joint.high - joint.low), 0), 1);
        row.place.style.left = `calc(${100 * part}% - ${0.3 * part}rem)`;
        row.limit.classList.toggle("near", part < 0.03 || part > 0.97);
        row.limit.title = `${number(joint.low, 2)} to ${number(joint.high, 2)} ${joint.unit}`;
      }
      row.learned.style.width = `${100 * (joint.learned ?? 0)}%`;
      row.bar.title = joint.learned === null ? "not known yet" : `${Math.round(100 * joint.learned)} %`;
    });
  }
}

export class PointList {
  constructor(ask, choose) {
    this.ask = ask;
    this.choose = choose;
    this.list = document.getElementById("points");
    this.rows = new Map();
  }

  show(points, chosen, steers) {
    document.getElementById("no-points").hidden = points.length > 0;
    document.getElementById("clear").hidden = !points.length;
    const present = new Set(points.map((point) => point.number));
    for (const [key, row] of this.rows) {
      if (!present.has(key)) {
        row.element.remove();
        this.rows.delete(key);
      }
    }
    for (const point of points) {
      const row = this.rows.get(point.number) ?? this.add(point);
      const error = point.error === null ? "no target" : `${number(point.error, 1)} px`;
      row.state.textContent = `${point.state}, ${error}`;
      row.state.className = { reached: "good", uncertain: "warn", lost: "bad", unreachable: "bad" }[point.state] ?? "";
      row.element.dataset.state = point.state;
      row.why.textContent = point.why;
      row.why.hidden = !point.why;
      row.why.className = `why ${point.state === "uncertain" ? "warn" : "bad"}`;
      row.element.classList.toggle("chosen", point.number === chosen);
      row.label.hidden = points.length < 2;
      if (document.activeElement !== row.weight) row.weight.value = Math.log10(point.weight);
      row.weight.disabled = row.remove.disabled = !steers;
    }
  }

  add(point) {
    const element = make("div", "point");
    const badge = element.appendChild(make("span", "number", String(point.number)));
    badge.style.background = colorOf(point.number);
    const state = element.appendChild(make("span"));
    const remove = element.appendChild(make("button", "", "Remove"));
    remove.type = "button";
    const why = element.appendChild(make("span", "why"));
    const label = element.appendChild(make("label", "", "weight"));
    const weight = label.appendChild(make("input"));
    Object.assign(weight, { type: "range", min: -1, max: 1, step: 0.1, value: 0 });
    weight.addEventListener("input", () => this.ask({ do: "weigh", point: point.number, weight: 10 ** Number(weight.value) }));
    label.addEventListener("click", (event) => event.stopPropagation());
    remove.addEventListener("click", (event) => {
      event.stopPropagation();
      this.ask({ do: "remove", point: point.number });
    });
    element.addEventListener("click", () => this.choose(point.number));
    this.list.append(element);
    const row = { element, state, why, label, weight, remove };
    this.rows.set(point.number, row);
    return row;
  }
}

export class LogList {
  constructor() {
    this.list = document.getElementById("log");
    this.last = 0;
  }

  show(lines) {
    for (const line of lines) {
      if (line.number <= this.last) continue;
      this.last = line.number;
      const item = make("li", { warning: "warn", error: "bad" }[line.level] ?? "");
      item.append(make("time", "", new Date(1000 * line.time).toLocaleTimeString([], { hour12: false })), line.text);
      this.list.prepend(item);
      while (this.list.children.length > 200) this.list.lastChild.remove();
    }
  }

  reset() {
    this.last = 0;
    this.list.replaceChildren();
  }
}
