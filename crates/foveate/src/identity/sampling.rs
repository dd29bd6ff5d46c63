#![allow(missing_docs)]
#[derive(Clone, Copy)]
pub struct Plane<'a> {
    pub data: &'a [f32],
    pub width: usize,
    pub height: usize,
    pub x0: f32,
    pub y0: f32,
}
#[derive(Clone, Copy)]
pub struct Bytes<'a> {
    pub data: &'a [u8],
    pub width: usize,
    pub height: usize,
}
pub fn taps(p: Plane<'_>, m: [f32; 6], du: &[f32], dv: &[f32], out: &mut [f32]) {
    let (w, h) = ((p.width - 1) as f32, (p.height - 1) as f32);
    for ((&u, &v), o) in du.iter().zip(dv).zip(out) {
        let x = (m[0] - p.x0 + m[2] * u + m[4] * v).clamp(0.0, w);
        let y = (m[1] - p.y0 + m[3] * u + m[5] * v).clamp(0.0, h);
        let (i, j) = ((x as usize).min(p.width.saturating_sub(2)), (y as usize).min(p.height.saturating_sub(2)));
        let (fx, fy) = (x - i as f32, y - j as f32);
        let a = j * p.width + i;
        let dx = usize::from(p.width > 1);
        let b = if p.height > 1 { a + p.width } else { a };
        let t = p.data[a] + (p.data[a + dx] - p.data[a]) * fx;
        let s = p.data[b] + (p.data[b + dx] - p.data[b]) * fx;
        *o = t + (s - t) * fy;
    }
}
pub fn box_means(
    src: Bytes<'_>,
    first: (isize, isize),
    size: (usize, usize),
    out: (usize, usize),
    data: &mut [f32],
    scratch: &mut Vec<f32>,
) {
    let rows = out.1 + size.1 - 1;
    scratch.clear();
    scratch.resize((rows + 1) * out.0, 0.0);
    let k = 1.0 / (255.0 * (size.0 * size.1) as f32);
    for r in 0..rows {
        let y = (first.1 + r as isize).clamp(0, src.height as isize - 1) as usize;
        let line = &src.data[y * src.width..][..src.width];
        let at = |x: isize| u32::from(line[x.clamp(0, src.width as isize - 1) as usize]);
        let mut sum: u32 = (0..size.0).map(|b| at(first.0 + b as isize)).sum();
        for c in 0..out.0 {
            scratch[r * out.0 + c] = sum as f32;
            let x = first.0 + c as isize;
            sum = sum + at(x + size.0 as isize) - at(x);
        }
    }
    let (lines, sum) = scratch.split_at_mut(rows * out.0);
    for r in 0..size.1 {
        for c in 0..out.0 {
            sum[c] += lines[r * out.0 + c];
        }
    }
    for r in 0..out.1 {
        for c in 0..out.0 {
            data[r * out.0 + c] = sum[c] * k;
            if r + 1 < out.1 {
                sum[c] += lines[(r + size.1) * out.0 + c] - lines[r * out.0 + c];
            }
        }
    }
}
