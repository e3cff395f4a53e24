"use strict";
// One cursor for all plots and maps of a run, sorting of tables, keys. The page works without it.
(() => {
  const runs = [...document.querySelectorAll("article.run")];
  const current = () => runs.find((run) => "#" + run.id === location.hash);

  const clamp = (x, low, high) => Math.max(low, Math.min(high, x));

  function pointsOf(line) {
    if (!line.wilPoints) {
      line.wilPoints = pointsIn(line.getAttribute("points") || "");
    }
    return line.wilPoints;
  }

  function pointsIn(text) {
    return text
      .split(" ")
      .filter(Boolean)
      .map((pair) => pair.split(",").map(Number));
  }

  // The points of a curve; `isLast`: the curve is broken after that one.
  function pointsOfCurve(curve) {
    if (!curve.wilPoints) {
      curve.wilPoints = (curve.getAttribute("d") || "").split("M").flatMap((stretch) => {
        const points = pointsIn(stretch);
        if (points.length) points[points.length - 1].isLast = true;
        return points;
      });
    }
    return curve.wilPoints;
  }

  function isInGap(points, index, x) {
    const before = points[index][0] <= x ? index : index - 1;
    return before >= 0 && before < points.length - 1 && points[before].isLast === true;
  }

  function nearest(points, x) {
    let low = 0;
    let high = points.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (points[middle][0] < x) low = middle;
      else high = middle;
    }
    return Math.abs(points[low][0] - x) <= Math.abs(points[high][0] - x) ? low : high;
  }

  // A mixture is valid until the next one; of poses the nearest is shown.
  function newestOf(line, points, x) {
    const index = nearest(points, x);
    const isLater = line.classList.contains("mixed") && points[index][0] > x + 0.06;
    return isLater && index > 0 ? index - 1 : index;
  }

  function setTime(run, time) {
    const begin = Number(run.dataset.begin);
    const end = Math.max(Number(run.dataset.end), begin + 1);
    const t = clamp(time, begin, end);
    run.wilTime = t;
    run.classList.add("at-time");
    const share = (t - begin) / (end - begin);
    const clock = run.querySelector(".clock");
    if (clock) clock.textContent = (t - Number(run.dataset.zero)).toFixed(2) + " s";
    for (const plot of run.querySelectorAll(".plot")) {
      const cursor = plot.querySelector("line.cursor");
      cursor.setAttribute("x1", 100 * share + "%");
      cursor.setAttribute("x2", 100 * share + "%");
      for (const line of plot.querySelectorAll("path.curve")) {
        const output = [...plot.querySelectorAll("output")].find(
          (one) => one.dataset.name === line.dataset.name,
        );
        const points = pointsOfCurve(line);
        if (!output || !points.length) continue;
        const index = newestOf(line, points, 1000 * share);
        const point = points[index];
        const low = Number(line.dataset.low);
        const high = Number(line.dataset.high);
        const value = high - (point[1] / 1000) * (high - low);
        const most = isInGap(points, index, 1000 * share) ? 4 : 20;
        const far = Math.abs(point[0] - 1000 * share) > most;
        output.textContent = far ? "–" : value.toFixed(Math.abs(high - low) > 20 ? 1 : 2);
      }
    }
    for (const map of run.querySelectorAll("svg.map")) {
      const spots = [...map.querySelectorAll("circle.spot")];
      [...map.querySelectorAll("polyline.track")].forEach((line, index) => {
        const points = pointsOf(line);
        if (!points.length || !spots[index]) return;
        const at = Math.round((t - Number(line.dataset.begin)) / Number(line.dataset.step));
        const point = points[clamp(at, 0, points.length - 1)];
        spots[index].setAttribute("cx", point[0]);
        spots[index].setAttribute("cy", point[1]);
      });
    }
  }

  function timeUnder(run, chart, event) {
    const box = chart.getBoundingClientRect();
    const begin = Number(run.dataset.begin);
    const end = Math.max(Number(run.dataset.end), begin + 1);
    return begin + ((event.clientX - box.left) / box.width) * (end - begin);
  }

  for (const run of runs) {
    for (const chart of run.querySelectorAll(".plot svg.chart")) {
      const follow = (event) => setTime(run, timeUnder(run, chart, event));
      chart.addEventListener("pointermove", follow);
      chart.addEventListener("pointerdown", follow);
    }
    run.addEventListener("click", (event) => {
      const jump = event.target.closest(".jump");
      if (!jump) return;
      setTime(run, Number(jump.dataset.t));
      const timeline = run.querySelector(".timeline");
      if (timeline && !event.target.closest(".strip")) {
        timeline.scrollIntoView({ block: "nearest" });
      }
    });
  }

  runs.forEach((run, index) => {
    const link = (name, other) => {
      const anchor = run.querySelector("nav ." + name);
      if (other) anchor.href = "#" + other.id;
      else anchor.remove();
    };
    link("previous", runs[index - 1]);
    link("next", runs[index + 1]);
  });

  // An image that is shown again, or is a video's poster, stands in the page only once.
  for (const again of document.querySelectorAll("[data-again]")) {
    const first = again.closest("article").querySelector(".saw .main img");
    if (again.tagName === "VIDEO") again.poster = first.src;
    else again.src = first.src;
  }

  for (const video of document.querySelectorAll("video")) {
    video.addEventListener("error", () => {
      video.hidden = true;
      video.parentElement.querySelector(".no-video").hidden = false;
    });
  }

  // A click or Enter enlarges a frame; arrow keys show its neighbours.
  const box = document.createElement("dialog");
  box.className = "lightbox";
  box.setAttribute("aria-label", "enlarged image");
  const shown = document.createElement("div");
  const foot = document.createElement("p");
  const caption = document.createElement("span");
  const buttons = document.createElement("span");
  const button = (text, act) => {
    const added = document.createElement("button");
    added.type = "button";
    added.textContent = text;
    added.addEventListener("click", act);
    buttons.append(added);
  };
  button("←", () => turn(-1));
  button("→", () => turn(1));
  button("close", () => box.close());
  foot.append(caption, buttons);
  box.append(shown, foot);
  document.body.append(box);
  let enlarged = null;

  function enlarge(opener) {
    enlarged = opener;
    shown.replaceChildren(opener.querySelector(".marked").cloneNode(true));
    const image = shown.querySelector("img");
    image.loading = "eager";
    caption.textContent = image.alt;
    if (!box.open) box.showModal();
  }

  function turn(step) {
    const group = enlarged.closest(".strip, .saw");
    const all = [...group.querySelectorAll("button.enlarge")];
    enlarge(all[clamp(all.indexOf(enlarged) + step, 0, all.length - 1)]);
  }

  box.addEventListener("close", () => {
    if (enlarged) enlarged.focus();
  });
  box.addEventListener("click", (event) => {
    if (event.target === box) box.close();
  });
  document.addEventListener("click", (event) => {
    const opener = event.target.closest("button.enlarge");
    if (opener && opener.closest("article")) enlarge(opener);
  });

  // Scroll the strip and the event list to the moment.
  function centre(run) {
    const frame = run.querySelector(".strip .now");
    if (frame) {
      const strip = frame.parentElement;
      const left = frame.getBoundingClientRect().left - strip.getBoundingClientRect().left;
      strip.scrollLeft += left - (strip.clientWidth - frame.clientWidth) / 2;
    }
    const row = run.querySelector(".events tr.decisive");
    if (row) {
      const list = row.closest(".events");
      const top = row.getBoundingClientRect().top - list.getBoundingClientRect().top;
      list.scrollTop += top - list.clientHeight / 2;
    }
  }

  // On a phone a row is a list of its cells, each with the head of its column.
  for (const table of document.querySelectorAll(".scroll table")) {
    if (!table.tHead) continue;
    table.classList.add("labelled");
    const heads = [...table.tHead.rows[0].cells].map((one) => one.textContent.trim());
    for (const row of table.tBodies[0].rows) {
      [...row.cells].forEach((cell, column) => {
        cell.dataset.label = heads[column] || "";
        cell.classList.toggle("nothing", ["", "–"].includes(cell.textContent.trim()));
      });
    }
  }

  // Mark tables that continue to the right.
  function hintAtWidth() {
    for (const one of document.querySelectorAll(".scroll")) {
      if (one.clientWidth) one.classList.toggle("wide", one.scrollWidth > one.clientWidth + 1);
    }
  }
  window.addEventListener("resize", hintAtWidth);

  function opened() {
    const run = current();
    if (run || location.hash === "#overview") window.scrollTo(0, 0);
    hintAtWidth();
    if (!run) return;
    run.focus({ preventScroll: true });
    centre(run);
    if (run.wilTime === undefined && run.dataset.moment) setTime(run, Number(run.dataset.moment));
  }
  window.addEventListener("hashchange", opened);
  opened();

  function go(step, onlyBad) {
    let index = runs.indexOf(current());
    for (;;) {
      index = index < 0 && step < 0 ? runs.length - 1 : index + step;
      if (index < 0 || index >= runs.length) return;
      if (!onlyBad || runs[index].dataset.bad) break;
    }
    location.hash = runs[index].id;
  }

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.target.closest("video, input, textarea")) return;
    if (box.open) {
      if (event.key === "ArrowLeft" || event.key === "ArrowRight") {
        turn(event.key === "ArrowLeft" ? -1 : 1);
        event.preventDefault();
      }
      return;
    }
    const run = current();
    const step = (event.shiftKey ? 1 : 0.05) * (event.key === "ArrowLeft" ? -1 : 1);
    if (event.key === "j") go(1, false);
    else if (event.key === "k") go(-1, false);
    else if (event.key === "n") go(1, true);
    else if (event.key === "o" || event.key === "Escape") location.hash = "overview";
    else if (run && run.dataset.moment && event.key === "Home") {
      setTime(run, Number(run.dataset.moment));
    } else if (
      run &&
      (event.key === "ArrowLeft" || event.key === "ArrowRight") &&
      !event.target.closest(".strip, .scroll")
    ) {
      setTime(run, (run.wilTime === undefined ? Number(run.dataset.begin) : run.wilTime) + step);
    } else return;
    event.preventDefault();
  });

  function valueOf(row, column) {
    const text = (row.cells[column] ? row.cells[column].textContent : "").trim();
    const number = parseFloat(text.replace("−", "-"));
    return Number.isNaN(number) ? { text, number: null } : { text, number };
  }

  function compare(a, b) {
    if (a.number !== null && b.number !== null) return a.number - b.number;
    if (a.number !== null || b.number !== null) return a.number !== null ? -1 : 1;
    return a.text.localeCompare(b.text, undefined, { numeric: true });
  }

  for (const table of document.querySelectorAll("table.sortable")) {
    [...table.tHead.rows[0].cells].forEach((head, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...head.childNodes);
      head.append(button);
      button.addEventListener("click", () => {
        const down = head.getAttribute("aria-sort") === "ascending";
        for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
        head.setAttribute("aria-sort", down ? "descending" : "ascending");
        const rows = [...table.tBodies[0].rows].map((row) => [valueOf(row, column), row]);
        rows.sort((a, b) => (down ? -1 : 1) * compare(a[0], b[0]));
        table.tBodies[0].append(...rows.map((pair) => pair[1]));
      });
    });
  }
})();
