// The people in a picture, from the landmarks of MediaPipe: [[u, v, x, y, z, visibility] x 33] for each person.

export const SEEN = 0.5; // visibility from which a landmark counts as seen
const ENOUGH = 5; // landmarks seen, for a person
const SAME_PERSON = 0.5; // share of the smaller box that two findings of one person have in common
const SHOULDERS_AND_HIPS = [11, 12, 23, 24], NOSE = [0], ANKLES = [27, 28];

function box(landmarks) {
  const seen = landmarks.filter((point) => point[5] > SEEN);
  if (seen.length < ENOUGH) return null;
  const u = seen.map((point) => point[0]), v = seen.map((point) => point[1]);
  const [left, right, top, bottom] = [Math.min(...u), Math.max(...u), Math.min(...v), Math.max(...v)];
  return { left, right, top, bottom, area: (right - left) * (bottom - top) };
}

function samePerson(a, b) {
  const width = Math.min(a.right, b.right) - Math.max(a.left, b.left);
  const height = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
  return width > 0 && height > 0 && width * height > SAME_PERSON * Math.min(a.area, b.area);
}

// True if a picture shows more than one person. A tracker may find the same one twice.
export function crowded(people) {
  const boxes = people.map(box).filter(Boolean);
  return boxes.some((one) => !samePerson(one, boxes[0]));
}

// The fault of a performer ([]: not found): "nobody", "part", "head" or "feet" not in the picture; "" if there is none.
export function wrongWith(landmarks) {
  if (!landmarks.length || !box(landmarks)) return "nobody";
  const shown = (i) => [0, 1].every((k) => landmarks[i][k] >= 0 && landmarks[i][k] <= 1);
  if (!SHOULDERS_AND_HIPS.every(shown)) return "part";
  if (!NOSE.every(shown)) return "head";
  return ANKLES.every(shown) ? "" : "feet";
}
