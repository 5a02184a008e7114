//! The point of a difference that is nearest to an origin outside of it (Gilbert, Johnson, Keerthi, 1988).

use super::difference::{Difference, Vertex};
use crate::math::{add_scaled, cross, dot, norm, scale, sub, Vec3};

/// Up to four corners; after `nearest`, those that carry the nearest point, with their shares.
#[derive(Clone, Copy, Default)]
struct Simplex {
    corners: [Vertex; 4],
    shares: [f64; 4],
    count: usize,
    point: Vec3,
    squared: f64,
}

impl Simplex {
    fn of(corners: &[Vertex], shares: &[f64], point: Vec3) -> Self {
        let mut found = Self { count: corners.len(), point, squared: dot(point, point), ..Self::default() };
        found.corners[..corners.len()].copy_from_slice(corners);
        found.shares[..corners.len()].copy_from_slice(shares);
        found
    }

    fn push(&mut self, corner: Vertex) {
        self.corners[self.count] = corner;
        self.count += 1;
    }

    /// Reduced to the part that carries the nearest point; None when the origin is within.
    fn nearest(&self) -> Option<Self> {
        let c = &self.corners;
        match self.count {
            1 => Some(Self::of(&c[..1], &[1.0], c[0].w)),
            2 => Some(on_segment(c[0], c[1])),
            3 => Some(on_triangle(c[0], c[1], c[2])),
            _ => on_tetrahedron(c),
        }
    }
}

fn nearer(a: Simplex, b: Simplex) -> Simplex {
    if b.squared < a.squared {
        b
    } else {
        a
    }
}

fn on_segment(a: Vertex, b: Vertex) -> Simplex {
    let edge = sub(b.w, a.w);
    let length2 = dot(edge, edge);
    let t = -dot(a.w, edge) / length2;
    // t is NaN if both ends are equal.
    if !(t > 0.0) {
        return Simplex::of(&[a], &[1.0], a.w);
    }
    if t >= 1.0 {
        return Simplex::of(&[b], &[1.0], b.w);
    }
    Simplex::of(&[a, b], &[1.0 - t, t], add_scaled(a.w, edge, t))
}

fn on_triangle(a: Vertex, b: Vertex, c: Vertex) -> Simplex {
    let n = cross(sub(b.w, a.w), sub(c.w, a.w));
    let n2 = dot(n, n);
    let shares = [dot(n, cross(b.w, c.w)), dot(n, cross(c.w, a.w)), dot(n, cross(a.w, b.w))];
    if n2 > 0.0 && shares.iter().all(|share| *share > 0.0) {
        let sum = shares[0] + shares[1] + shares[2];
        let point = scale(n, dot(n, a.w) / n2);
        return Simplex::of(&[a, b, c], &[shares[0] / sum, shares[1] / sum, shares[2] / sum], point);
    }
    nearer(nearer(on_segment(a, b), on_segment(b, c)), on_segment(c, a))
}

fn on_tetrahedron(c: &[Vertex; 4]) -> Option<Simplex> {
    let mut best: Option<Simplex> = None;
    for [i, j, k, opposite] in [[0, 1, 2, 3], [0, 1, 3, 2], [0, 2, 3, 1], [1, 2, 3, 0]] {
        let n = cross(sub(c[j].w, c[i].w), sub(c[k].w, c[i].w));
        let (inner, origin) = (dot(n, sub(c[opposite].w, c[i].w)), -dot(n, c[i].w));
        if inner * origin > 0.0 {
            continue;
        }
        let found = on_triangle(c[i], c[j], c[k]);
        best = Some(best.map_or(found, |before| nearer(before, found)));
    }
    best
}

/// Most iterations: a polytope takes about five, and beyond this only rounding keeps it going.
const ITERATIONS: usize = 100;

/// The nearest point of a difference, and the offset from A's centre of A's point behind it.
pub struct Apart {
    pub point: Vec3,
    pub of_a: Vec3,
}

/// The nearest point to `tolerance`, a share of the distance; None if the cores meet.
pub fn nearest_apart(m: &Difference, start: Vec3, tolerance: f64) -> Option<Apart> {
    let mut simplex = Simplex::default();
    simplex.push(m.lowest(start));
    simplex = simplex.nearest()?;
    for _ in 0..ITERATIONS {
        let v = simplex.point;
        let squared = dot(v, v);
        if squared < 1e-24 {
            return None;
        }
        let next = m.lowest(v);
        let known = simplex.corners[..simplex.count].iter().any(|corner| norm(sub(corner.w, next.w)) == 0.0);
        // v . w is a lower bound of |v|^2 at the optimum, so their difference bounds the error.
        if known || squared - dot(v, next.w) <= tolerance * squared {
            break;
        }
        let mut larger = simplex;
        larger.push(next);
        // The distance must fall in every step. If rounding stops it, the last simplex is the result.
        let found = larger.nearest()?;
        if dot(found.point, found.point) >= squared {
            break;
        }
        simplex = found;
    }
    let of_a = (0..simplex.count).fold([0.0; 3], |sum, k| add_scaled(sum, simplex.corners[k].a, simplex.shares[k]));
    Some(Apart { point: simplex.point, of_a })
}
