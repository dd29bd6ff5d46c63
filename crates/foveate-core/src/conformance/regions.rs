//! The conformance test of sources that serve regions.

use crate::scene::sensor::{Regions, Window};

/// Checks that a window's bytes depend on the window alone, and that the mean of a bin lies between the pixels that it covers, within two
/// grey levels for sources that keep rounded coarser pictures. Bins at the borders may be cut.
pub fn regions(source: &dyn Regions) {
    let [width, height, planes] = source.shape();
    assert!(width > 0 && height > 0 && (planes == 1 || planes == 3), "{width} x {height} with {planes} planes");
    let read = |window: Window| {
        let mut out = vec![0; planes * window.columns * window.rows];
        source.read(window, &mut out).expect("a source that can be read");
        out
    };
    let pixels = read(Window { x: 0, y: 0, columns: width, rows: height, bin: (1, 1) });
    for bin in [(1, 1), (2, 2), (4, 4), (8, 8)] {
        let window = Window { x: 0, y: 0, columns: width.div_ceil(bin.0), rows: height.div_ceil(bin.1), bin };
        let means = read(window);
        assert_eq!(means, read(window), "a window read twice has the same values");
        for (k, mean) in means.iter().enumerate() {
            let n = window.columns * window.rows;
            let (p, i, j) = (k / n, k % n % window.columns, k % n / window.columns);
            let rows = j * bin.1..((j + 1) * bin.1).min(height);
            let covered = rows.flat_map(|y| (i * bin.0..((i + 1) * bin.0).min(width)).map(move |x| (x, y)));
            let values: Vec<u8> = covered.map(|(x, y)| pixels[(p * height + y) * width + x]).collect();
            let (least, most) = (values.iter().min(), values.iter().max());
            let (least, most) = (*least.expect("a pixel"), *most.expect("a pixel"));
            let within = least.saturating_sub(2)..=most.saturating_add(2);
            assert!(within.contains(mean), "bin ({i}, {j}) of {bin:?} is {mean}, not in {within:?}");
        }
    }
    assert_eq!(source.shape(), [width, height, planes], "reading changes no shape");
}
