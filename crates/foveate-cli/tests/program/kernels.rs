//! `FOVEATE_KERNELS` takes other vector instructions, and the tracks agree: bit for bit with AVX2 and AVX-512, and closely in portable code,
//! where multiply-adds round twice. The products of an RBM are summed in other orders by each, and agree closely.

use crate::place::{Place, errors};
use foveate_testing::skip;

/// track.csv of a run with these instructions; `None` where the processor lacks them.
fn track(place: &Place, config: &str, kernels: &str) -> Option<String> {
    let mut command = place.command(["track", "video", "-c", config, "--no-video", "--no-report", "-o", kernels]);
    let output = command.env("FOVEATE_KERNELS", kernels).output().expect("it starts");
    if errors(&output).contains("this processor has none") {
        skip(&format!("processor with {kernels}"));
        return None;
    }
    assert!(output.status.success(), "{}", errors(&output));
    Some(place.text(&format!("{kernels}/track.csv")))
}

#[test]
fn all_instructions_give_the_same_track() {
    let place = Place::new();
    for config in ["c.toml", "natural", "natural-fast", "digits-hedge", "digits-rbm"] {
        let [portable, avx2, avx512] = ["portable", "avx2", "avx512"].map(|kernels| track(&place, config, kernels));
        if let Some((avx2, avx512)) = avx2.as_ref().zip(avx512.as_ref()) {
            assert!(avx2 == avx512 || config == "digits-rbm", "{config}: AVX2 and AVX-512 differ");
        }
        let (Some(portable), Some(avx2)) = (portable, avx2) else { continue };
        assert_eq!(portable.lines().count(), avx2.lines().count());
        for (a, b) in portable.lines().zip(avx2.lines()).skip(1) {
            let numbers =
                |line: &str| line.split(',').skip(1).take(4).filter_map(|x| x.parse().ok()).collect::<Vec<f64>>();
            for (a, b) in numbers(a).iter().zip(numbers(b)) {
                assert!((a - b).abs() < 1.0, "{config}: {a} in portable code, {b} with AVX2");
            }
        }
    }
    let mut command = place.command(["configs"]);
    let output = command.env("FOVEATE_KERNELS", "mmx").output().expect("it starts");
    assert!(!output.status.success() && errors(&output).contains("expected portable, avx2 or avx512"));
}
