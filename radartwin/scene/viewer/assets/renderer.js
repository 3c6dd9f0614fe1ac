// Draws the scene in two passes: first colours and surface numbers into textures, then the colours onto the window with outlines between
// different surface numbers. The surface numbers also identify the surface under the pointer.

const MESH_VERTEX = `#version 300 es
in vec3 position; in vec4 paint; in vec3 picture; in uint surface;
uniform mat4 matrix; uniform vec3 eye;
out vec3 toEye; out float height; out vec4 painted; out vec2 place; flat out float layer; flat out uint index;
void main() {
  gl_Position = matrix * vec4(position, 1.0);
  toEye = eye - position; height = position.z; painted = paint; index = surface;
  place = picture.xy; layer = picture.z;
}`;

// Normals are computed per triangle, so meshes need none, and both sides are lit.
const MESH_FRAGMENT = `#version 300 es
precision highp float; precision highp int; precision highp sampler2D; precision highp sampler2DArray;
in vec3 toEye; in float height; in vec4 painted; in vec2 place; flat in float layer; flat in uint index;
uniform sampler2D table; uniform sampler2DArray pictures; uniform float cut; uniform bool scanColours;
layout(location = 0) out vec4 colour; layout(location = 1) out vec4 number;
void main() {
  ivec2 at = ivec2(int(index) % 1024, int(index) / 1024);
  vec4 entry = texelFetch(table, at, 0);
  vec3 seen = texture(pictures, vec3(place, max(layer, 0.0))).rgb;
  if (entry.a < 0.25 || height > cut) discard;
  vec3 normal = normalize(cross(dFdx(toEye), dFdy(toEye)));
  vec3 look = normalize(toEye);
  if (dot(normal, look) < 0.0) normal = -normal;
  float light = 0.66 + 0.17 * max(dot(normal, normalize(vec3(-0.35, -0.6, 0.72))), 0.0) + 0.09 * normal.z + 0.1 * dot(normal, look);
  vec3 base = !scanColours ? entry.rgb : layer >= 0.0 ? seen : painted.a > 0.5 ? painted.rgb : entry.rgb;
  colour = vec4(base * min(light, 1.06), 1.0);
  uint id = index + 1u;
  vec2 crease = entry.a > 0.75 ? normal.xy * 0.49 + 0.5 : vec2(0.5);
  number = vec4(float(id & 255u) / 255.0, float(id >> 8) / 255.0, crease);
}`;

const LINE_VERTEX = `#version 300 es
in vec2 corner; in vec3 from; in vec3 to; in vec4 paint; in float width;
uniform mat4 matrix; uniform vec2 size;
out vec4 painted;
void main() {
  vec4 a = matrix * vec4(from, 1.0), b = matrix * vec4(to, 1.0);
  float near = 1e-3;
  if (a.w < near) a = mix(a, b, (near - a.w) / (b.w - a.w));
  if (b.w < near) b = mix(b, a, (near - b.w) / (a.w - b.w));
  vec2 along = normalize((b.xy / b.w - a.xy / a.w) * size + 1e-6);
  vec4 end = corner.x < 0.5 ? a : b;
  vec2 shift = (vec2(-along.y, along.x) * corner.y + along * (corner.x - 0.5) * 0.7) * width;
  gl_Position = end + vec4(shift / size * 2.0 * end.w, -2e-4 * end.w, 0.0);
  painted = paint;
}`;

const LINE_FRAGMENT = `#version 300 es
precision highp float;
in vec4 painted;
layout(location = 0) out vec4 colour; layout(location = 1) out vec4 number;
void main() { colour = painted; number = vec4(1.0); }`;

const SCREEN_VERTEX = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;

const SCREEN_FRAGMENT = `#version 300 es
precision highp float; precision highp sampler2D;
uniform sampler2D colours; uniform sampler2D numbers; uniform int grain;
out vec4 result;
float edge(ivec2 at, ivec2 step) {
  vec4 here = texelFetch(numbers, at, 0), there = texelFetch(numbers, at + step, 0);
  if (here.g == 1.0 || there.g == 1.0) return 0.0;
  if (here.rg != there.rg) return 0.62;
  return distance(here.ba, there.ba) > 0.12 ? 0.3 : 0.0;
}
void main() {
  vec3 sum = vec3(0.0);
  for (int y = 0; y < grain; y++) for (int x = 0; x < grain; x++) {
    ivec2 at = ivec2(gl_FragCoord.xy) * grain + ivec2(x, y);
    float line = max(edge(at, ivec2(1, 0)), edge(at, ivec2(0, 1)));
    sum += mix(texelFetch(colours, at, 0).rgb, vec3(0.11, 0.15, 0.2), line);
  }
  result = vec4(sum / float(grain * grain), 1.0);
}`;

class Renderer {
  constructor(canvas, mesh, surfaces, lines, pictures) {
    const gl = canvas.getContext("webgl2", { antialias: false, powerPreference: "high-performance" });
    if (!gl) throw new Error("This page draws with WebGL 2, which this browser does not offer or has switched off.");
    this.gl = gl;
    this.canvas = canvas;
    this.programs = { mesh: this.program(MESH_VERTEX, MESH_FRAGMENT), line: this.program(LINE_VERTEX, LINE_FRAGMENT),
      screen: this.program(SCREEN_VERTEX, SCREEN_FRAGMENT) };
    this.count = mesh.indices.length;
    this.grain = this.count > 900000 ? 1 : 2; // 2 x 2 samples per pixel, except for large meshes
    this.mesh = gl.createVertexArray();
    gl.bindVertexArray(this.mesh);
    this.attribute(this.programs.mesh, "position", mesh.positions, 3, gl.FLOAT);
    this.attribute(this.programs.mesh, "paint", mesh.colours, 4, gl.UNSIGNED_BYTE);
    this.attribute(this.programs.mesh, "picture", mesh.pictures, 3, gl.FLOAT);
    this.attribute(this.programs.mesh, "surface", mesh.surface, 1, gl.UNSIGNED_SHORT, 0, 0, true);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, mesh.indices, gl.STATIC_DRAW);
    this.setLines(lines);
    this.rows = Math.ceil(surfaces / 1024);
    this.table = gl.createTexture();
    this.setPictures(pictures);
    this.screen = gl.createVertexArray();
    gl.enable(gl.DEPTH_TEST);
  }

  program(vertex, fragment) {
    const gl = this.gl;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    return program;
  }

  attribute(program, name, data, size, type, stride = 0, offset = 0, whole = false, divisor = 0) {
    const gl = this.gl;
    const at = gl.getAttribLocation(program, name);
    if (data) {
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    }
    gl.enableVertexAttribArray(at);
    if (whole) gl.vertexAttribIPointer(at, size, type, stride, offset);
    else gl.vertexAttribPointer(at, size, type, type === gl.UNSIGNED_BYTE, stride, offset);
    gl.vertexAttribDivisor(at, divisor);
  }

  /** Lines: [{from, to, colour: [r, g, b], width}], width in window pixels. */
  setLines(lines) {
    const gl = this.gl;
    const program = this.programs.line;
    const data = new Float32Array(lines.flatMap((l) => [...l.from, ...l.to, ...l.colour.map((c) => c / 255), 1, l.width * this.grain]));
    this.lineCount = lines.length;
    this.lines = gl.createVertexArray();
    gl.bindVertexArray(this.lines);
    this.attribute(program, "corner", new Float32Array([0, -0.5, 1, -0.5, 0, 0.5, 1, 0.5]), 2, gl.FLOAT);
    this.attribute(program, "from", data, 3, gl.FLOAT, 44, 0, false, 1);
    for (const [name, size, offset] of [["to", 3, 12], ["paint", 4, 24], ["width", 1, 40]])
      this.attribute(program, name, null, size, gl.FLOAT, 44, offset, false, 1);
  }

  /** Square pictures of one size as the layers of a repeating texture. */
  setPictures(pictures) {
    const gl = this.gl;
    const side = pictures.length ? pictures[0].width : 1;
    this.pictures = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.pictures);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, Math.floor(Math.log2(side)) + 1, gl.RGBA8, side, side, Math.max(1, pictures.length));
    pictures.forEach((picture, k) => gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, k, side, side, 1, gl.RGBA, gl.UNSIGNED_BYTE, picture));
    gl.generateMipmap(gl.TEXTURE_2D_ARRAY);
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
  }

  /** One RGBA entry per surface; alpha 0 hides the surface, 128 draws it without creases, 255 with creases. */
  setTable(entries) {
    const gl = this.gl;
    const padded = new Uint8Array(4 * 1024 * this.rows);
    padded.set(entries);
    gl.bindTexture(gl.TEXTURE_2D, this.table);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 1024, this.rows, 0, gl.RGBA, gl.UNSIGNED_BYTE, padded);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  }

  resize(width, height) {
    if (this.canvas.width === width && this.canvas.height === height) return;
    const gl = this.gl;
    Object.assign(this.canvas, { width, height });
    const size = [width * this.grain, height * this.grain];
    for (const old of this.targets || []) gl.deleteTexture(old);
    gl.deleteRenderbuffer(this.depth || null);
    gl.deleteFramebuffer(this.frame || null);
    this.frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    this.targets = [0, 1].map((k) => {
      const texture = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, ...size);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + k, gl.TEXTURE_2D, texture, 0);
      return texture;
    });
    this.depth = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, this.depth);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, ...size);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, this.depth);
    this.size = size;
  }

  draw(camera, cut, scanColours) {
    const gl = this.gl;
    const matrix = camera.matrix();
    const set = (program, name, how, ...value) => gl[how](gl.getUniformLocation(program, name), ...value);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
    gl.viewport(0, 0, ...this.size);
    gl.clearBufferfv(gl.COLOR, 0, [0.933, 0.949, 0.961, 1]);
    gl.clearBufferfv(gl.COLOR, 1, [0, 0, 0, 0]);
    gl.clearBufferfv(gl.DEPTH, 0, [1]);
    const { mesh, line, screen } = this.programs;
    gl.useProgram(mesh);
    gl.bindTexture(gl.TEXTURE_2D, this.table);
    gl.activeTexture(gl.TEXTURE2);
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.pictures);
    gl.activeTexture(gl.TEXTURE0);
    set(mesh, "table", "uniform1i", 0);
    set(mesh, "pictures", "uniform1i", 2);
    set(mesh, "matrix", "uniformMatrix4fv", false, matrix);
    set(mesh, "eye", "uniform3fv", camera.eye);
    set(mesh, "cut", "uniform1f", cut);
    set(mesh, "scanColours", "uniform1i", scanColours ? 1 : 0);
    gl.bindVertexArray(this.mesh);
    gl.drawElements(gl.TRIANGLES, this.count, gl.UNSIGNED_INT, 0);
    if (this.lineCount) {
      gl.useProgram(line);
      set(line, "matrix", "uniformMatrix4fv", false, matrix);
      set(line, "size", "uniform2fv", this.size);
      gl.bindVertexArray(this.lines);
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.lineCount);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.useProgram(screen);
    this.targets.forEach((texture, k) => {
      gl.activeTexture(gl.TEXTURE0 + k);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      set(screen, k ? "numbers" : "colours", "uniform1i", k);
    });
    gl.activeTexture(gl.TEXTURE0);
    set(screen, "grain", "uniform1i", this.grain);
    gl.bindVertexArray(this.screen);
    gl.disable(gl.DEPTH_TEST);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.enable(gl.DEPTH_TEST);
  }

  /** Number of the surface at a pixel of the canvas, from its top left, or -1. A pixel on a line gives the nearest surface. */
  pick(x, y) {
    const gl = this.gl;
    const reach = 4 * this.grain;
    const side = 2 * reach + 1;
    const pixels = new Uint8Array(4 * side * side);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.readBuffer(gl.COLOR_ATTACHMENT1);
    gl.readPixels(x * this.grain - reach, this.size[1] - 1 - y * this.grain - reach, side, side, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    const at = (dx, dy) => {
      const k = 4 * ((reach + dy) * side + reach + dx);
      return pixels[k + 1] === 255 ? null : pixels[k] + 256 * pixels[k + 1] - 1;
    };
    for (let r = 0; r <= reach; r++)
      for (const [dx, dy] of [[r, r], [-r, r], [r, -r], [-r, -r]]) if (at(dx, dy) !== null) return at(dx, dy);
    return -1;
  }
}
