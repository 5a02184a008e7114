//! Distance of a vector from a cone: non-negative least squares (Lawson and Hanson, "Solving Least Squares Problems", 1974).

pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Orthonormal vectors that span `rows`. A part below 1e-8 of the length counts as dependent.
pub fn basis(rows: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut found: Vec<Vec<f64>> = vec![];
    for row in rows {
        let size = dot(row, row).sqrt();
        let mut left = row.clone();
        without(&mut left, &found);
        without(&mut left, &found);
        let length = dot(&left, &left).sqrt();
        if length > 1e-8 * size.max(1e-30) {
            found.push(left.iter().map(|x| x / length).collect());
        }
    }
    found
}

/// Remove from `v` its part in the span of an orthonormal basis.
pub fn without(v: &mut [f64], basis: &[Vec<f64>]) {
    for q in basis {
        let along = dot(v, q);
        v.iter_mut().zip(q).for_each(|(x, y)| *x -= along * y);
    }
}

/// Shares x of `columns` that bring their sum nearest to `b`.
fn least_squares(columns: &[&Vec<f64>], b: &[f64]) -> Vec<f64> {
    // By Gram-Schmidt, twice: R x = Q^T b.
    let (mut q, mut r): (Vec<Vec<f64>>, Vec<Vec<f64>>) = (vec![], vec![]);
    for column in columns {
        let (mut left, mut shares) = (column.to_vec(), vec![0.0; q.len()]);
        for _ in 0..2 {
            for (share, unit) in shares.iter_mut().zip(&q) {
                let along = dot(&left, unit);
                *share += along;
                left.iter_mut().zip(unit).for_each(|(x, y)| *x -= along * y);
            }
        }
        let length = dot(&left, &left).sqrt();
        q.push(left.iter().map(|x| if length > 0.0 { x / length } else { 0.0 }).collect());
        shares.push(length);
        r.push(shares);
    }
    let mut x: Vec<f64> = q.iter().map(|unit| dot(unit, b)).collect();
    for j in (0..x.len()).rev() {
        for k in j + 1..x.len() {
            x[j] -= r[k][j] * x[k];
        }
        x[j] = if r[j][j] > 1e-10 { x[j] / r[j][j] } else { 0.0 };
    }
    x
}

/// The distance of `b` from the cone of `generators` and the space that the orthonormal `free` spans.
pub fn distance(b: &[f64], generators: &[Vec<f64>], free: &[Vec<f64>]) -> f64 {
    let mut b = b.to_vec();
    without(&mut b, free);
    let mut columns: Vec<Vec<f64>> = vec![];
    for generator in generators {
        let size = dot(generator, generator).sqrt();
        let mut column = generator.clone();
        without(&mut column, free);
        without(&mut column, free);
        let length = dot(&column, &column).sqrt();
        if length > 1e-8 * size {
            columns.push(column.iter().map(|v| v / length).collect());
        }
    }
    let scale = dot(&b, &b).sqrt();
    let mut x = vec![0.0; columns.len()];
    let mut used: Vec<usize> = vec![];
    for _ in 0..10 * (columns.len() + 1) {
        let left = residual(&b, &columns, &x);
        let best = (0..columns.len())
            .filter(|k| !used.contains(k))
            .max_by(|i, j| dot(&columns[*i], &left).total_cmp(&dot(&columns[*j], &left)));
        match best {
            Some(k) if dot(&columns[k], &left) > 1e-11 * (1.0 + scale) => used.push(k),
            _ => break,
        }
        loop {
            let chosen: Vec<&Vec<f64>> = used.iter().map(|k| &columns[*k]).collect();
            let desired = least_squares(&chosen, &b);
            // As far as none turns negative; an entry that reaches zero is out.
            let stop = used.iter().zip(&desired).filter(|(_, w)| **w <= 0.0).map(|(k, w)| x[*k] / (x[*k] - w));
            let share = stop.fold(1.0, f64::min);
            let share = if share.is_nan() { 0.0 } else { share };
            for (k, w) in used.iter().zip(&desired) {
                x[*k] += share * (w - x[*k]);
            }
            if share == 1.0 {
                break;
            }
            used.retain(|k| x[*k] > 1e-14);
            for k in 0..x.len() {
                x[k] = if used.contains(&k) { x[k] } else { 0.0 };
            }
        }
    }
    let left = residual(&b, &columns, &x);
    dot(&left, &left).sqrt()
}

fn residual(b: &[f64], columns: &[Vec<f64>], x: &[f64]) -> Vec<f64> {
    let mut left = b.to_vec();
    for (column, share) in columns.iter().zip(x) {
        left.iter_mut().zip(column).for_each(|(v, c)| *v -= share * c);
    }
    left
}

#[test]
fn a_quarter_of_the_plane() {
    let axes = [vec![1.0, 0.0], vec![1.0, 1.0]];
    let cases = [([2.0, 1.0], 0.0), ([-3.0, 0.0], 3.0), ([0.0, 1.0], 0.5_f64.sqrt()), ([1.0, -2.0], 2.0)];
    for (b, expected) in cases {
        assert!((distance(&b, &axes, &[]) - expected).abs() < 1e-14, "{b:?}");
    }
    assert!(distance(&[-3.0, 1.0], &axes, &[vec![1.0, 0.0]]) < 1e-14);
    assert!((distance(&[-3.0, -1.0], &axes, &[vec![1.0, 0.0]]) - 1.0).abs() < 1e-14);
}
