//! A path of postures in time: rows of joint values, straight in joint space between them.

use super::arms::Arm;

#[derive(Default)]
pub struct Way {
    movers: usize,
    rows: usize,
    /// (rows, movers)
    values: Vec<f64>,
    /// How far each joint has gone until each row, (rows, movers).
    gone: Vec<f64>,
    /// Last row at which anything still moves in: from it on the path rests.
    pub end: usize,
}

impl Way {
    /// Take over rows of values; at least one.
    pub fn load(&mut self, values: &[f64], movers: usize) {
        (self.movers, self.rows, self.end) = (movers, values.len() / movers, 0);
        self.values.clear();
        self.values.extend_from_slice(values);
        self.gone.clear();
        self.gone.resize(values.len(), 0.0);
        for k in movers..values.len() {
            let step = (values[k] - values[k - movers]).abs();
            self.gone[k] = self.gone[k - movers] + step;
            if step > 0.0 {
                self.end = k / movers;
            }
        }
    }

    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Values at a time in rows, into the entries `columns` of a posture.
    pub fn at(&self, time: f64, columns: &[usize], q: &mut [f64]) {
        let (row, share) = self.place(time);
        let (before, after) = (&self.values[row * self.movers..], &self.values[self.next(row) * self.movers..]);
        for (k, column) in columns.iter().enumerate() {
            q[*column] = if share > 0.0 { before[k] + share * (after[k] - before[k]) } else { before[k] };
        }
    }

    /// How far a joint has gone until a time in rows.
    pub fn gone(&self, mover: usize, time: f64) -> f64 {
        let (row, share) = self.place(time);
        let (before, after) = (self.gone[row * self.movers + mover], self.gone[self.next(row) * self.movers + mover]);
        before + share * (after - before)
    }

    /// Most that the joints of these arms move one side against the other between two times in rows, m; arms that turn are
    /// longer by `stretch`.
    pub fn motion(&self, arms: &[Arm], stretch: f64, from: f64, to: f64) -> f64 {
        let moved = |arm: &Arm| {
            let length = if arm.turns { arm.length + stretch } else { arm.length };
            length * (self.gone(arm.mover, to) - self.gone(arm.mover, from))
        };
        arms.iter().map(moved).sum()
    }

    /// Largest size that a joint's value has on the way.
    pub fn largest(&self, mover: usize) -> f64 {
        self.values.iter().skip(mover).step_by(self.movers).fold(0.0, |a: f64, v| a.max(v.abs()))
    }

    fn place(&self, time: f64) -> (usize, f64) {
        let row = (time as usize).min(self.rows - 1);
        (row, time - row as f64)
    }

    fn next(&self, row: usize) -> usize {
        (row + 1).min(self.rows - 1)
    }
}
