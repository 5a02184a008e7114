//! Small dense least squares by Householder reflections, for rank-deficient or damped levels.

/// Column-major work matrix, reused.
#[derive(Default)]
pub struct SmallLeastSquares {
    a: Vec<f64>,
    b: Vec<f64>,
    rows: usize,
    columns: usize,
}

impl SmallLeastSquares {
    /// Room for problems of this size.
    pub fn reserve(&mut self, rows: usize, columns: usize) {
        self.a.reserve((rows * columns).saturating_sub(self.a.len()));
        self.b.reserve(rows.saturating_sub(self.b.len()));
    }

    pub fn start(&mut self, rows: usize, columns: usize) {
        self.rows = rows;
        self.columns = columns;
        self.a.clear();
        self.a.resize(rows * columns, 0.0);
        self.b.clear();
        self.b.resize(rows, 0.0);
    }

    #[inline(always)]
    pub fn set(&mut self, r: usize, c: usize, value: f64) {
        self.a[c * self.rows + r] = value;
    }

    #[inline(always)]
    pub fn set_target(&mut self, r: usize, value: f64) {
        self.b[r] = value;
    }

    /// argmin ||A y - b|| into `y`; A has full column rank.
    pub fn solve(&mut self, y: &mut [f64]) {
        let (m, n) = (self.rows, self.columns);
        for c in 0..n {
            let (done, rest) = self.a.split_at_mut((c + 1) * m);
            let column = &mut done[c * m..];
            let tail: f64 = column[c..].iter().map(|x| x * x).sum::<f64>().sqrt();
            if tail == 0.0 {
                continue;
            }
            let alpha = if column[c] > 0.0 { -tail } else { tail };
            // Reflector v, kept in the column below the diagonal with v[c] apart.
            let head = column[c] - alpha;
            let beta = -1.0 / (alpha * head);
            column[c] = head;
            let v = &column[c..];
            for other in rest.chunks_exact_mut(m) {
                reflect(v, beta, &mut other[c..]);
            }
            reflect(v, beta, &mut self.b[c..]);
            column[c] = alpha;
        }
        for c in (0..n).rev() {
            let mut sum = self.b[c];
            for k in c + 1..n {
                sum -= self.a[k * m + c] * y[k];
            }
            let diagonal = self.a[c * m + c];
            y[c] = if diagonal != 0.0 { sum / diagonal } else { 0.0 };
        }
    }
}

#[inline]
fn reflect(v: &[f64], beta: f64, x: &mut [f64]) {
    let s: f64 = v.iter().zip(x.iter()).map(|(a, b)| a * b).sum::<f64>() * beta;
    for (value, a) in x.iter_mut().zip(v) {
        *value -= s * a;
    }
}
