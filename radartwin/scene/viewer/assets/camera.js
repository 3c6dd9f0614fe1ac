// Column-major matrices for WebGL, and a camera that orbits a target point; z is up.

const vec = {
  add: (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]],
  sub: (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]],
  scale: (a, s) => [a[0] * s, a[1] * s, a[2] * s],
  dot: (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2],
  cross: (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]],
  unit: (a) => vec.scale(a, 1 / (Math.hypot(...a) || 1)),
};

function multiply(a, b) {
  const out = new Float32Array(16);
  for (let c = 0; c < 4; c++)
    for (let r = 0; r < 4; r++) for (let k = 0; k < 4; k++) out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
  return out;
}

class Camera {
  constructor(low, high) {
    this.middle = vec.scale(vec.add(low, high), 0.5);
    this.size = Math.max(Math.hypot(...vec.sub(high, low)), 0.2);
    this.low = low;
    this.high = high;
    this.overview();
  }

  overview() {
    Object.assign(this, { target: [...this.middle], azimuth: -2.05, elevation: 0.72, fov: 0.62 });
    this.fit();
  }

  top() {
    Object.assign(this, { target: [...this.middle], azimuth: -Math.PI / 2, elevation: Math.PI / 2 - 1e-3, fov: 0.5 });
    this.fit();
  }

  /** Increase the distance until the scene fits into the part of the window beside the panel. */
  fit() {
    this.fitted = true;
    this.distance = 0.05 * this.size;
    const corners = [];
    for (let k = 0; k < 8; k++) corners.push([0, 1, 2].map((a) => (k & (1 << a) ? this.high : this.low)[a]));
    const inside = (p) => Math.abs(p[0]) < 0.97 && p[1] < 0.84 && p[1] > -0.88;
    while (this.distance < 20 * this.size && !corners.every((c) => inside(this.project(c)))) this.distance *= 1.03;
  }

  /** View from the radar along its boresight. */
  lookFrom(position, direction) {
    this.distance = 1.5;
    this.target = vec.add(position, vec.scale(direction, this.distance));
    this.azimuth = Math.atan2(-direction[1], -direction[0]);
    this.elevation = Math.asin(Math.max(-1, Math.min(1, -direction[2])));
    this.fov = 1.2;
    this.fitted = false;
  }

  /** Fit the scene again, unless the user has moved the camera: a frame may open before it has a size. */
  resize(aspect, shift) {
    Object.assign(this, { aspect, shift });
    if (this.fitted) this.fit();
  }

  get eye() {
    const level = Math.cos(this.elevation);
    const back = [level * Math.cos(this.azimuth), level * Math.sin(this.azimuth), Math.sin(this.elevation)];
    return vec.add(this.target, vec.scale(back, this.distance));
  }

  axes() {
    const forward = vec.unit(vec.sub(this.target, this.eye));
    const right = [-Math.sin(this.azimuth), Math.cos(this.azimuth), 0];
    return { forward, right, up: vec.cross(right, forward) };
  }

  /** World to clip coordinates, shifted to the left because the panel covers the right of the window. */
  matrix() {
    const { forward, right, up } = this.axes();
    const eye = this.eye;
    const near = Math.max(this.distance * 0.01, 0.005);
    const far = this.distance + 4 * this.size;
    const f = 1 / Math.tan(this.fov / 2);
    const squeeze = f / this.aspect;
    const projection = [squeeze, 0, 0, 0, 0, f, 0, 0, this.shift, 0, -(far + near) / (far - near), -1, 0, 0, (-2 * far * near) / (far - near), 0];
    const view = [
      right[0], up[0], -forward[0], 0, right[1], up[1], -forward[1], 0, right[2], up[2], -forward[2], 0,
      -vec.dot(right, eye), -vec.dot(up, eye), vec.dot(forward, eye), 1,
    ];
    return multiply(projection, view);
  }

  aspect = 1;
  shift = 0;

  /** Horizontal, vertical and depth coordinates in -1..1 in the part of the window beside the panel. */
  project(point) {
    const m = this.matrix();
    const w = m[3] * point[0] + m[7] * point[1] + m[11] * point[2] + m[15];
    if (w <= 0) return [9, 9, 9];
    const clip = [0, 1, 2].map((r) => (m[r] * point[0] + m[4 + r] * point[1] + m[8 + r] * point[2] + m[12 + r]) / w);
    return [(clip[0] + this.shift) / (1 - Math.abs(this.shift)), clip[1], clip[2]];
  }

  turn(dx, dy) {
    this.fitted = false;
    this.azimuth -= dx * 0.006;
    this.elevation = Math.max(-1.55, Math.min(Math.PI / 2 - 1e-3, this.elevation + dy * 0.006));
  }

  pan(dx, dy, height) {
    this.fitted = false;
    const { right, up } = this.axes();
    const metres = (2 * this.distance * Math.tan(this.fov / 2)) / height;
    this.target = vec.add(this.target, vec.add(vec.scale(right, -dx * metres), vec.scale(up, dy * metres)));
  }

  zoom(factor) {
    this.fitted = false;
    this.distance = Math.max(0.02, Math.min(20 * this.size, this.distance * factor));
  }
}
