// Pointer, touch, wheel and keys in the plane. One finger scrolls the page, two fingers move and zoom the plane.
{
  let grip = null, moved = false;
  const { canvas } = plane, fingers = new Map();
  // Middle of two fingers, and the distance between them.
  const pinch = () => {
    const [[x0, y0], [x1, y1]] = fingers.values();
    return { x: (x0 + x1) / 2, y: (y0 + y1) / 2, apart: Math.max(Math.hypot(x1 - x0, y1 - y0), 1) };
  };
  const release = (event) => {
    grip = null;
    fingers.delete(event.pointerId);
  };
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button) return;
    if (event.pointerType === "touch" && fingers.size < 2) fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
    else if (event.pointerType !== "touch") grip = [event.offsetX, event.offsetY];
    moved = fingers.size > 1;
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (fingers.has(event.pointerId)) {
      const before = fingers.size > 1 && pinch();
      fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
      if (!before) return;
      const now = pinch();
      plane.move(now.x - before.x, now.y - before.y);
      plane.zoom(now.apart / before.apart, now.x, now.y);
      return;
    }
    if (!grip) {
      const hit = plane.nearest(event);
      showTip(event, hit ? laneWords(hit, hit.step).replace(/^/, `t = ${time(hit.step)}\n`) : "");
      return;
    }
    if (!moved && Math.hypot(event.offsetX - grip[0], event.offsetY - grip[1]) < 5) return;
    moved = true;
    tip.hidden = true;
    plane.move(event.offsetX - grip[0], event.offsetY - grip[1]);
    grip = [event.offsetX, event.offsetY];
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, release);
  canvas.addEventListener("pointerleave", () => { tip.hidden = true; });
  canvas.addEventListener("click", (event) => {
    if (moved) { moved = false; return; }
    const hit = plane.nearest(event);
    if (hit) choose({ side: hit.side.name, track: hit.track, step: hit.step });
  });
  canvas.addEventListener("wheel", (event) => {
    if (document.activeElement !== canvas && !event.ctrlKey) return;
    event.preventDefault();
    plane.zoom(event.deltaY < 0 ? 1.25 : 0.8, event.offsetX, event.offsetY);
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const way = { ArrowLeft: [40, 0], ArrowRight: [-40, 0], ArrowUp: [0, 40], ArrowDown: [0, -40] }[event.key];
    if (taken(event)) return;
    if (way) plane.move(...way);
    else if (bigger(event)) plane.zoom(1.4);
    else if (smaller(event)) plane.zoom(1 / 1.4);
    else if (event.key === "0") planeAct("all");
    else return;
    event.preventDefault();
  });
}
