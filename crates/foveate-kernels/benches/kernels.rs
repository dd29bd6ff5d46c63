//! Rates of the kernels beside the limits of this core, one JSON line each: `cargo bench -p foveate-kernels`.
//! Words after `--` choose the lines that contain them all.
//!
//! The clock is the thread's CPU time; a figure is the median of 15 runs of about 10 ms.

use foveate_kernels::*;
use std::hint::black_box;

/// CPU time of this thread, seconds.
#[cfg(target_os = "linux")]
fn now() -> f64 {
    #[repr(C)]
    struct TimeSpec {
        seconds: std::ffi::c_long,
        nanoseconds: std::ffi::c_long,
    }
    unsafe extern "C" {
        fn clock_gettime(clock: std::ffi::c_int, time: *mut TimeSpec) -> std::ffi::c_int;
    }
    const THREAD_CPU_TIME: std::ffi::c_int = 3;
    let mut time = TimeSpec { seconds: 0, nanoseconds: 0 };
    // SAFETY: the C library's own function, given a place to write to.
    unsafe { clock_gettime(THREAD_CPU_TIME, &mut time) };
    time.seconds as f64 + 1e-9 * time.nanoseconds as f64
}

/// Time since the first call, seconds.
#[cfg(not(target_os = "linux"))]
fn now() -> f64 {
    static START: std::sync::LazyLock<std::time::Instant> = std::sync::LazyLock::new(std::time::Instant::now);
    START.elapsed().as_secs_f64()
}

/// Median seconds of one call.
fn time(mut f: impl FnMut()) -> f64 {
    let (start, mut calls) = (now(), 0);
    while now() - start < 0.01 {
        f();
        calls += 1;
    }
    let mut runs: Vec<f64> = (0..15)
        .map(|_| {
            let start = now();
            (0..calls).for_each(|_| f());
            (now() - start) / calls as f64
        })
        .collect();
    runs.sort_by(f64::total_cmp);
    runs[7]
}

/// One line: what, its time, its rate, and the limit of that rate where there is one.
fn report(what: &str, count: f64, unit: &str, limit: Option<f64>, f: impl FnMut()) {
    if !std::env::args().skip(1).all(|word| word.starts_with("--") || what.contains(&word)) {
        return;
    }
    let seconds = time(f);
    let rate = count / seconds;
    let share =
        limit.map_or(String::new(), |limit| format!(", \"limit\": {limit:.3e}, \"share\": {:.3}", rate / limit));
    println!(
        "{{\"what\": \"{what}\", \"us\": {:.3}, \"ns_each\": {:.4}, \"rate\": {rate:.3e}, \"unit\": \"{unit}/s\"{share}}}",
        1e6 * seconds,
        1e9 * seconds / count
    );
}

/// Values in [0, 1) from a fixed linear congruence.
fn values(n: usize, mut seed: u32) -> Vec<f32> {
    std::iter::repeat_with(|| {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 8) as f32 / (1 << 24) as f32
    })
    .take(n)
    .collect()
}

/// Operations a second of multiply-adds that wait for nothing: f32, and bf16 where there is an instruction.
fn peaks() -> (Option<f64>, Option<f64>) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::*;
        const TURNS: usize = 10_000;
        #[target_feature(enable = "avx512f")]
        fn f32_512() {
            let (mut acc, x) = ([_mm512_set1_ps(0.5); 16], _mm512_set1_ps(black_box(0.5)));
            for _ in 0..TURNS {
                for acc in &mut acc {
                    *acc = _mm512_fmadd_ps(*acc, x, x);
                }
            }
            black_box(acc);
        }
        #[target_feature(enable = "avx512f,avx512bf16")]
        fn bf16_512() {
            let (mut acc, x) =
                ([_mm512_set1_ps(0.5); 16], _mm512_cvtne2ps_pbh(_mm512_setzero_ps(), _mm512_setzero_ps()));
            for _ in 0..TURNS {
                for acc in &mut acc {
                    *acc = _mm512_dpbf16_ps(*acc, x, x);
                }
            }
            black_box(acc);
        }
        let rate = |seconds: f64, operations: usize| (TURNS * 16 * operations) as f64 / seconds;
        let level = Level::best();
        // SAFETY: the processor has the level.
        let f32 = (level >= Level::Avx512).then(|| rate(time(|| unsafe { f32_512() }), 32));
        // SAFETY: the same.
        let bf16 = (level == Level::Avx512Dots).then(|| rate(time(|| unsafe { bf16_512() }), 64));
        (f32, bf16)
    }
    #[cfg(not(target_arch = "x86_64"))]
    (None, None)
}

fn main() {
    let (f32_peak, bf16_peak) = peaks();
    let shown = |peak: Option<f64>| peak.map_or("null".into(), |peak| format!("{peak:.3e}"));
    println!(
        "{{\"level\": \"{:?}\", \"f32 peak\": {}, \"bf16 peak\": {}, \"unit\": \"flop/s\"}}",
        Level::best(),
        shown(f32_peak),
        shown(bf16_peak)
    );

    // The layers of the box regression.
    for (side, channels, size, stride, filters) in
        [(68, 3, 5, 2, 16), (34, 17, 3, 2, 32), (18, 32, 3, 2, 64), (10, 64, 3, 1, 64), (10, 64, 3, 2, 48)]
    {
        let places = (side - size) / stride + 1;
        let weights: Vec<i8> = (0..size * size * channels * filters).map(|i| (i * 53 % 255) as i8).collect();
        let (paired, bias) = (paired(&weights, size * channels, filters), values(filters, 9));
        let (mut map, mut out) = (vec![], vec![0.0; places * places * filters]);
        let step = to_steps(&values(side * side * channels, 10), (side, channels, 0), &mut map);
        let layer = Layer { side, channels, size, stride, cut: true, weights: &paired, scales: &bias, bias: &bias };
        let what = format!("convolve, {side} x {side} x {channels} by {filters} of {size} x {size}");
        report(&what, (2 * places * places * weights.len()) as f64, "flop", f32_peak, || {
            convolve(black_box(&layer), &map, step, &mut out);
        });
    }

    let x = values(128_000, 1);
    let (mut y, bias) = (x.clone(), values(500, 2));
    let n = x.len() as f64;
    report("logistic", n, "elements", None, || logistic(black_box(&mut y)));
    report("bias_logistic, rows of 500", n, "elements", None, || bias_logistic(black_box(&mut y), &bias));
    let (a, b) = (values(500, 3), values(500, 4));
    report("sum, 500", 500.0, "elements", None, || {
        black_box(sum(black_box(&a)));
    });
    report("dot, 500", 500.0, "elements", None, || {
        black_box(dot(black_box(&a), &b));
    });
    report("squared_distance, 500", 500.0, "elements", None, || {
        black_box(squared_distance(black_box(&a), &b));
    });
    report("root_overlap, 500", 500.0, "elements", None, || {
        black_box(root_overlap(black_box(&a), &b));
    });
    report("presence, 500", 500.0, "elements", None, || {
        black_box(presence(black_box(&a), &b, 0.3, 0.5));
    });

    let pixels: Vec<u8> = values(640 * 480, 7).iter().map(|x| (x * 256.0) as u8).collect();
    let image = Pixels { data: &pixels, width: 640, height: 480 };
    let (mut scratch, mut means) = (BoxScratch::default(), vec![0.0; 640 * 480]);
    for (width, height) in [(120, 120), (640, 480)] {
        let region = Region { x: 0, y: 0, width, height };
        for side in [1, 2, 3, 4, 6, 8, 16, 33] {
            let count = width * height;
            report(&format!("box_means {side} x {side}, {width} x {height}"), count as f64, "pixels", None, || {
                box_means(black_box(image), (side, side), region, &mut scratch, &mut means[..count]);
            });
        }
    }
    report("intensity, 640 x 480", pixels.len() as f64, "pixels", None, || {
        intensity([black_box(&pixels), &pixels, &pixels], &mut means);
    });
    let (grey, mut across, mut half) = (values(640 * 480, 13), vec![0.0; 320 * 480], vec![0.0; 320 * 240]);
    report("halve, 640 x 480", pixels.len() as f64, "pixels", None, || {
        halve(black_box(&grey), 640, &mut across, &mut half);
    });
    for depth in [3, 4] {
        let (interleaved, mut planes) = (pixels.repeat(depth), vec![0; 3 * pixels.len()]);
        report(&format!("planes of {depth} bytes a pixel, 640 x 480"), pixels.len() as f64, "pixels", None, || {
            let (red, rest) = planes.split_at_mut(pixels.len());
            let (green, blue) = rest.split_at_mut(pixels.len());
            take_apart(black_box(&interleaved), depth, [red, green, blue]);
        });
    }
    let mut sums = vec![0; 640];
    report("half_intensity, 640 x 480", pixels.len() as f64, "pixels", None, || {
        half_intensity([black_box(&pixels), &pixels, &pixels], 640, &mut sums, &mut half);
    });
    let (mut bins, mut rows) = (vec![0; 640], vec![0; 2 * 641]);
    let table: Vec<u16> = (0..COLOUR_BINS).map(|i| i as u16).collect();
    report("colour_bins and integral_row, 640", 640.0, "pixels", None, || {
        colour_bins([black_box(&pixels[..640]), &pixels[640..1280], &pixels[1280..1920]], &mut bins);
        let (above, here) = rows.split_at_mut(641);
        integral_row(&bins, 1, &table, above, here);
    });
    let region = Region { x: 250, y: 170, width: 140, height: 140 };
    let plane = box_means(image, (3, 3), region, &mut scratch, &mut means[..140 * 140]);
    let maps: Vec<[f32; 6]> = values(600, 8)
        .chunks(6)
        .map(|r| {
            [310.0 + 20.0 * r[0], 230.0 + 20.0 * r[1], 1.0 + 0.1 * r[2], 0.1 * r[3], -0.1 * r[3], 1.0 + 0.1 * r[2]]
        })
        .collect();
    for cells in [48, 144, 240] {
        let (du, dv): (Vec<f32>, Vec<f32>) = (0..cells).map(|i| ((i % 16) as f32 - 7.5, (i / 16) as f32 - 7.5)).unzip();
        let mut out = vec![0.0; 100 * cells];
        let count = out.len() as f64;
        report(&format!("taps, {cells} cells"), count, "taps", None, || {
            for (map, out) in maps.iter().zip(out.chunks_exact_mut(cells)) {
                taps(plane, *map, &du, &dv, out);
            }
        });
        report(&format!("taps_rows, 100 x {cells} cells"), count, "taps", None, || {
            taps_rows(plane, black_box(&maps), &du, &dv, &mut out, cells)
        });
    }

    for (step, side) in [(1.2, 18), (3.0, 18), (6.0, 18), (12.0, 4)] {
        let maps: Vec<[f32; 6]> =
            values(96, 8).chunks(2).map(|r| [310.0 + 20.0 * r[0], 230.0 + 20.0 * r[1], step, 0.0, 0.0, step]).collect();
        let (du, dv): (Vec<f32>, Vec<f32>) = (0..side * side).map(|i| ((i % side) as f32, (i / side) as f32)).unzip();
        let mut out = vec![0.0; 48 * side * side];
        let plane = Plane { data: &grey, width: 640, height: 480, stride: 640, x0: 0.0, y0: 0.0 };
        report(&format!("taps_rows upright, 48 x {side} x {side} of {step}"), out.len() as f64, "taps", None, || {
            taps_rows(plane, black_box(&maps), &du, &dv, &mut out, side * side)
        });
    }
    let (patches, mut shapes) = (values(48 * 324, 10), vec![0.0; 48 * 192]);
    report("oriented, 48 x 4 blocks", 48.0, "glimpses", None, || {
        for (patch, out) in patches.chunks_exact(324).zip(shapes.chunks_exact_mut(192)) {
            let (gradients, squares) = out.split_at_mut(128);
            oriented(black_box(patch), 4, gradients, squares);
        }
    });
    let (glimpses, mut features) = (values(48 * 356, 10), vec![0.0; 48 * 224]);
    let lengths = Lengths { length: [0.8, 0.4, 0.3], flat: [0.05, 0.1, 0.03], neither: 0.5 };
    report("oriented_features, 48 x 4 blocks", 48.0, "glimpses", None, || {
        for (glimpse, out) in glimpses.chunks_exact(356).zip(features.chunks_exact_mut(224)) {
            oriented_features(black_box(glimpse), 4, &lengths, out);
        }
    });
    // The lattice of 9 × 9 places two blocks apart.
    let (columns, halves) = (40, 40 * 40);
    let (cells, colour) = (values(82 * 82, 14), values(halves, 15));
    let (mut gradients, mut blocks, mut sums) = (vec![0.0; 8 * halves], vec![0.0; 8 * halves], vec![0.0; halves]);
    report("features_among, 9 x 9 places of 4 blocks", 81.0, "glimpses", None, || {
        oriented_halves(black_box(&cells), columns, &mut gradients, &mut sums);
        oriented_blocks(&gradients, columns, &mut blocks);
        let maps = Maps { columns, blocks: &blocks, grey: &sums, colour: [&colour, &colour] };
        for k in 0..81 {
            features_among(&maps, k / 9 * 4 * columns + k % 9 * 4, 4, &lengths, &mut features[..224]);
        }
    });
    let (rows, vector) = (values(64 * 225, 11), values(225, 12));
    let (mut gram, mut out) = (vec![0.0; 225 * 113], vec![0.0; 225]);
    report("add_outer, 64 x 225", (64 * 225 * 226) as f64, "flop", f32_peak, || {
        add_outer(black_box(&rows), 225, 0.9, 0.1, &mut gram);
    });
    report("symmetric_times, 225", (2 * 225 * 225) as f64, "flop", f32_peak, || {
        symmetric_times(black_box(&gram), &vector, &mut out);
    });

    let (n_v, n_h) = (240, 500);
    let w: Vec<f32> = values(n_v * n_h, 5).iter().map(|x| (x - 0.5) * 0.2).collect();
    for n in [1, 100, 500, 1000] {
        let (v, mut h) = (values(n * n_v, 6), vec![0.0; n * n_h]);
        let (mut totals, mut overlaps) = (vec![0.0; n], vec![0.0; n]);
        let flops = (2 * n * n_v * n_h) as f64;
        for (name, packed, peak) in [
            ("f32", PackedWeights::f32(n_v, n_h, &w), f32_peak),
            ("bf16", PackedWeights::bf16(n_v, n_h, &w), bf16_peak),
            ("int8", PackedWeights::int8(n_v, n_h, &w), None),
        ] {
            report(&format!("features {name}, {n} x 240 x 500"), flops, "flop", peak, || {
                packed.features(black_box(&v), &bias, &mut h)
            });
            report(&format!("overlaps {name}, {n} x 240 x 500"), flops, "flop", peak, || {
                packed.overlaps(black_box(&v), &bias, &a, &mut totals, &mut overlaps)
            });
        }
    }

    frame(image, &bias, &w);
}

/// The kernels' share of one tracker frame: levels of the pyramid where the particles are, glimpses of 144 + 48 + 48
/// cells of 1, 3 and 6 pixels, and the sums of their overlap with the template.
fn frame(image: Pixels<'_>, bias: &[f32], weights: &[f32]) {
    // Cells of side 1, 3 and 6 fill squares of 12, 24 and 48 pixels, each but where the one before lies.
    let ring = |cell: i32, outer: i32, inner: i32| -> (Vec<f32>, Vec<f32>) {
        let (cell, outer, inner) = (cell as f32, outer as f32 / 2.0, inner as f32 / 2.0);
        let side = (2.0 * outer / cell) as usize;
        let middle = |i: usize| (i as f32 + 0.5) * cell - outer;
        (0..side * side)
            .map(|i| (middle(i % side), middle(i / side)))
            .filter(|(u, v)| u.abs() > inner || v.abs() > inner)
            .unzip()
    };
    let rings = [(1, ring(1, 12, 0)), (3, ring(3, 24, 12)), (6, ring(6, 48, 24))];
    let packed = PackedWeights::bf16(240, 500, weights);
    let mut scratch = BoxScratch::default();
    for (name, region) in [
        ("whole image", Region { x: 0, y: 0, width: 640, height: 480 }),
        ("120 x 120", Region { x: 260, y: 180, width: 120, height: 120 }),
    ] {
        let mut level = vec![0.0; region.width * region.height];
        for n in [100, 500, 1000] {
            let maps: Vec<[f32; 6]> = values(4 * n, 9)
                .chunks(4)
                .map(|r| {
                    let (c, s) = (1.0 + 0.05 * (r[2] - 0.5), 0.1 * (r[3] - 0.5));
                    [312.0 + 16.0 * r[0], 232.0 + 16.0 * r[1], c, s, -s, c]
                })
                .collect();
            let (mut glimpses, mut totals, mut overlaps) = (vec![0.0; n * 240], vec![0.0; n], vec![0.0; n]);
            report(&format!("frame kernels, {name}, {n}"), 1.0, "frames", None, || {
                let mut first = 0;
                for (side, (du, dv)) in &rings {
                    let plane = box_means(image, (*side, *side), region, &mut scratch, &mut level);
                    taps_rows(plane, &maps, du, dv, &mut glimpses[first..], 240);
                    first += du.len();
                }
                packed.overlaps(&glimpses, bias, bias, &mut totals, &mut overlaps);
                black_box(&overlaps);
            });
        }
    }
}
