/** Texts and discs over the 3-D picture: sharp, whatever pixels the picture itself has. */
import {THREE} from 'nicegui-scene';
import {colour, FONT} from '/static/canvas.js';

/** Draws the world's labels where they are seen by the camera; those further off first. */
export function drawLabels(canvas, camera, world) {
  const context = canvas.getContext('2d');
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  context.setTransform(canvas.width / width, 0, 0, canvas.height / height, 0, 0);
  context.clearRect(0, 0, width, height);
  const onScreen = ([x, y, z]) => {
    const p = new THREE.Vector3(y, -z, -x).project(camera);
    return {x: (0.5 + 0.5 * p.x) * width, y: (0.5 - 0.5 * p.y) * height, far: p.z};
  };
  const seen = world.labels.map(label => {
    const p = onScreen(label.at);
    return label.from ? {...label, ...p, from: onScreen(label.from)} : {...label, ...p};
  });
  context.textAlign = 'center';
  context.textBaseline = 'middle';
  for (const label of seen.filter(p => Math.abs(p.far) < 1).sort((a, b) => b.far - a.far)) {
    if (label.disc) disc(context, label);
    else plate(context, label);
  }
}

function disc(context, {x, y, text, name, disc: radius}) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fillStyle = colour(name);
  context.fill();
  context.strokeStyle = colour('bg');
  context.lineWidth = 1.5;
  context.stroke();
  context.font = `600 ${text.length > 2 ? 9 : 12}px ${FONT}`;
  context.fillStyle = colour('bg');
  context.fillText(text, x, y + 0.5);
}

/** A text on a plate; at the head of an arrow beyond it. */
function plate(context, {x, y, text, name, from}) {
  context.font = `600 13px ${FONT}`;
  const wide = context.measureText(text).width + 10;
  if (from) {
    const away = Math.hypot(x - from.x, y - from.y) || 1;
    x += (x - from.x) / away * (wide / 2 + 4);
    y += (y - from.y) / away * 14;
  }
  context.beginPath();
  context.roundRect(x - wide / 2, y - 10, wide, 20, 4);
  context.globalAlpha = 0.85;
  context.fillStyle = colour('panel');
  context.fill();
  context.globalAlpha = 1;
  context.fillStyle = colour(name);
  context.fillText(text, x, y + 0.5);
}
