//! The point of a difference that is nearest to the origin (Gilbert, Johnson, Keerthi, 1988), where the origin is outside.

use super::difference::Difference;
use super::simplex::Simplex;
use crate::math::{dot, norm, sub, Vec3};

/// Above it, rounding alone keeps the iteration going; a polytope takes about five.
const ITERATIONS: usize = 100;

/// The nearest point of a difference, and the offset from A's centre of A's point behind it.
pub struct Apart {
    pub point: Vec3,
    pub of_a: Vec3,
}

/// To `tolerance`, a share of the distance; None where the cores meet.
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
        if known || squared - dot(v, next.w) <= tolerance * squared {
            break;
        }
        let mut larger = simplex;
        larger.push(next);
        let found = larger.nearest()?;
        if dot(found.point, found.point) >= squared {
            break;
        }
        simplex = found;
    }
    Some(Apart { point: simplex.point, of_a: simplex.point_of_a() })
}
