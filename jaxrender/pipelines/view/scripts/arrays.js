// Arrays out of text, and small matrices.

const KINDS = {
  uint8: Uint8Array, uint16: Uint16Array, int16: Int16Array, uint32: Uint32Array,
  float16: Uint16Array, float32: Float32Array,
};

// Read an array as the page holds it; numbers of 16 bits become ordinary ones.
function unpacked(stored) {
  const text = atob(stored.data);
  const bytes = new Uint8Array(text.length);
  for (let k = 0; k < text.length; ++k) bytes[k] = text.charCodeAt(k);
  const numbers = new KINDS[stored.kind](bytes.buffer);
  return stored.kind === "float16" ? Float32Array.from(numbers, ofHalf) : numbers;
}

function ofHalf(bits) {
  const sign = bits & 0x8000 ? -1 : 1, exponent = (bits >> 10) & 31, part = bits & 1023;
  if (exponent === 31) return part ? NaN : sign * Infinity;
  return sign * (exponent ? 2 ** (exponent - 15) * (1 + part / 1024) : 2 ** -14 * (part / 1024));
}

// Unfold unit directions from the square that they were folded onto.
function unfolded(square) {
  const directions = new Float32Array(square.length / 2 * 3);
  for (let k = 0; 2 * k < square.length; ++k) {
    let x = square[2 * k] / 32767, y = square[2 * k + 1] / 32767;
    const z = 1 - Math.abs(x) - Math.abs(y), fold = Math.max(-z, 0);
    x -= x >= 0 ? fold : -fold;
    y -= y >= 0 ? fold : -fold;
    const length = Math.hypot(x, y, z);
    directions.set([x / length, y / length, z / length], 3 * k);
  }
  return directions;
}

// Put arrays of numbers one after the other.
function joined(arrays) {
  if (arrays.length === 1) return arrays[0];
  const found = new Float32Array(arrays.length * arrays[0].length);
  arrays.forEach((one, k) => found.set(one, k * one.length));
  return found;
}

// Matrices are lists of nine numbers, row by row.
const IDENTITY = [1, 0, 0, 0, 1, 0, 0, 0, 1];

function product(a, b) {
  const found = [];
  for (let row = 0; row < 3; ++row)
    for (let column = 0; column < 3; ++column)
      found.push(a[3 * row] * b[column] + a[3 * row + 1] * b[3 + column]
        + a[3 * row + 2] * b[6 + column]);
  return found;
}

function applied(m, v) {
  return [0, 3, 6].map((k) => m[k] * v[0] + m[k + 1] * v[1] + m[k + 2] * v[2]);
}

function rotationAbout(axis, angle) {
  const [x, y, z] = axis, c = Math.cos(angle), s = Math.sin(angle), r = 1 - c;
  return [
    c + x * x * r, x * y * r - z * s, x * z * r + y * s,
    y * x * r + z * s, c + y * y * r, y * z * r - x * s,
    z * x * r - y * s, z * y * r + x * s, c + z * z * r,
  ];
}

function directionOf(azimuth, elevation) {
  const c = Math.cos(elevation);
  return [c * Math.cos(azimuth), c * Math.sin(azimuth), Math.sin(elevation)];
}

// The rows are right, up and backwards of a camera that looks at the middle, as look_at has them.
function viewFromWorld(azimuth, elevation) {
  const backwards = directionOf(azimuth, elevation);
  const right = [-Math.sin(azimuth), Math.cos(azimuth), 0];
  const up = [
    backwards[1] * right[2] - backwards[2] * right[1],
    backwards[2] * right[0] - backwards[0] * right[2],
    backwards[0] * right[1] - backwards[1] * right[0],
  ];
  return [...right, ...up, ...backwards];
}
