//! A convex polygon cut by a rectangle about the origin, and its middle.

/// Most corners: sixteen, and one more for each of four cuts.
const MOST: usize = 20;

#[derive(Default)]
pub struct Polygon {
    points: [[f64; 2]; MOST],
    count: usize,
}

impl Polygon {
    pub fn clear(&mut self) {
        self.count = 0;
    }

    pub fn push(&mut self, point: [f64; 2]) {
        // More corners than fit come from rounding alone, and lie on ones that are there.
        if self.count < MOST {
            self.points[self.count] = point;
            self.count += 1;
        }
    }

    pub fn points(&self) -> &[[f64; 2]] {
        &self.points[..self.count]
    }

    /// Keep in `out` what is on the inner side: sign * coordinate `k` <= bound (Sutherland and Hodgman).
    fn cut(&self, k: usize, sign: f64, bound: f64, out: &mut Self) {
        out.clear();
        let Some(mut before) = self.points().last().copied() else { return };
        for &point in self.points() {
            let (over, over_before) = (sign * point[k] - bound, sign * before[k] - bound);
            if (over > 0.0) != (over_before > 0.0) {
                let share = over_before / (over_before - over);
                out.push([before[0] + share * (point[0] - before[0]), before[1] + share * (point[1] - before[1])]);
            }
            if over <= 0.0 {
                out.push(point);
            }
            before = point;
        }
    }

    /// Cut to |x| <= half[0], |y| <= half[1]; `room` is used on the way.
    pub fn clip(&mut self, half: [f64; 2], room: &mut Self) {
        for k in 0..2 {
            self.cut(k, 1.0, half[k], room);
            room.cut(k, -1.0, half[k], self);
        }
    }

    /// Centre of area; of a polygon that has none, the centre of what it spans. None where nothing is left.
    pub fn middle(&self) -> Option<[f64; 2]> {
        let first = *self.points().first()?;
        let (mut area, mut moment, mut low, mut high) = (0.0, [0.0; 2], first, first);
        for (point, next) in self.points().iter().zip(self.points()[1..].iter().chain([&first])) {
            let (p, q) = ([point[0] - first[0], point[1] - first[1]], [next[0] - first[0], next[1] - first[1]]);
            let twice = p[0] * q[1] - p[1] * q[0];
            area += twice;
            for k in 0..2 {
                moment[k] += twice * (p[k] + q[k]);
                low[k] = low[k].min(point[k]);
                high[k] = high[k].max(point[k]);
            }
        }
        let span = (high[0] - low[0]).max(high[1] - low[1]);
        if area.abs() > 1e-6 * span * span {
            return Some([first[0] + moment[0] / (3.0 * area), first[1] + moment[1] / (3.0 * area)]);
        }
        Some([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])])
    }
}
