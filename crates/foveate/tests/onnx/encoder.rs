//! Networks as first layers.

use std::collections::BTreeSet;

use foveate::config::Config;
use foveate::conformance;
use foveate::files::Nowhere;
use foveate::identity::Encoder;
use foveate::identity::onnx::OnnxEncoder;
use foveate::identity::retina::{Foveal, FovealConfig, Retina};
use foveate::rows::{Rows, RowsMut};

use super::networks::{convolution, deep, identity, linear, numbers};
use super::writer::{Attribute, Network};
use super::{File, check, said, track, truth};

const RINGS: &str = "rings = [[8, 1], [16, 2], [24, 4]]";
const ONE: &str = "rings = [[24, 2]]";
const COLOUR: &str = "rings = [[24, 2]], colour = [[24, 2]]";
const ONNX: &str = "{ kind = \"onnx\", model = \"a.onnx\" }";

/// The encoder of a configuration.
fn encoder(retina: &str, encoder: &str, file: &[u8]) -> std::sync::Arc<dyn Encoder> {
    let blueprint = check(retina, encoder, file).expect("a network that fits");
    let (_, encoder) = blueprint.config().identity(&File(file.to_vec())).expect("it was checked");
    encoder
}

fn features(encoder: &dyn Encoder, glimpses: &[f32]) -> Vec<f32> {
    let (n_v, n_h) = encoder.shape();
    let mut h = vec![f32::NAN; glimpses.len() / n_v * n_h];
    encoder.encode(Rows::new(glimpses, n_v), RowsMut::new(&mut h, n_h));
    h
}

fn glimpses(rows: usize, n_v: usize) -> Vec<f32> {
    numbers(rows * n_v, 9).into_iter().map(|x| x + 0.5).collect()
}

/// Its whole name stands here for the law's sake: `OnnxEncoder`.
#[test]
fn it_keeps_the_law() {
    let _: Option<OnnxEncoder> = None;
    let weights = (numbers(132 * 40, 1), numbers(40, 2));
    for batch in [0, 1, 5] {
        let encoder = encoder(RINGS, ONNX, &linear(batch, 132, 40, &weights.0, &weights.1));
        conformance::encoder(&*encoder, &glimpses(37, 132));
    }
    conformance::encoder(&*encoder("rings = [[32, 1]]", ONNX, &deep(3)), &glimpses(18, 1024));
    let (w, b) = (numbers(4 * 9, 3), numbers(4, 4));
    conformance::encoder(&*encoder(ONE, ONNX, &convolution(12, 4, &w, &b)), &glimpses(35, 144));
}

/// By sums in f64, and whatever batch the file fixes, to the bit.
#[test]
fn a_linear_network_is_a_product() {
    let (w, b, v) = (numbers(132 * 40, 1), numbers(40, 2), glimpses(37, 132));
    let all = [0, 1, 5].map(|batch| features(&*encoder(RINGS, ONNX, &linear(batch, 132, 40, &w, &b)), &v));
    assert!(all[0] == all[1] && all[0] == all[2], "the batch changes a bit");
    for (row, h) in v.chunks_exact(132).zip(all[0].chunks_exact(40)) {
        for (k, h) in h.iter().enumerate() {
            let terms = row.iter().enumerate().map(|(i, v)| f64::from(*v) * f64::from(w[i * 40 + k]));
            let exact = f64::from(b[k]) + terms.sum::<f64>();
            assert!((f64::from(*h) - exact).abs() < 1e-4, "{h}, not {exact}");
        }
    }
}

/// Plain loops are the oracle: means over 2 × 2 places of rectified filters.
#[test]
fn a_convolution_is_that_of_plain_loops() {
    let (side, filters) = (14, 16);
    let (w, b) = (numbers(filters * 9, 3), numbers(filters, 4));
    let v = glimpses(20, side * side);
    let h = features(&*encoder("rings = [[28, 2]]", ONNX, &convolution(side, filters, &w, &b)), &v);
    let places = (side - 2) / 2;
    for (v, h) in v.chunks_exact(side * side).zip(h.chunks_exact(filters * places * places)) {
        let filter = |f: usize, x: usize, y: usize| {
            let products = (0..9).map(|i| w[f * 9 + i] * v[(y + i / 3) * side + x + i % 3]);
            (b[f] + products.sum::<f32>()).max(0.0)
        };
        for (i, found) in h.iter().enumerate() {
            let (f, x, y) = (i / (places * places), 2 * (i % places), 2 * (i / places % places));
            let wanted: f32 = (0..4).map(|k| filter(f, x + k % 2, y + k / 2)).sum::<f32>() / 4.0;
            assert!((found - wanted).abs() < 1e-5, "{i}: {found}, not {wanted}");
        }
    }
}

/// An identity network is the raw encoder, to the last bit, on rings, on a grid, in the opponent colours; on any number of threads.
#[test]
fn the_identity_tracks_as_raw_does() {
    let opponent = "{ kind = \"onnx\", model = \"a.onnx\", planes = \"opponent\" }";
    for (retina, kind, planes, sides) in [
        (RINGS, ONNX, 1, &[0, 132][..]),
        (ONE, ONNX, 1, &[0, 1, 12, 12]),
        (ONE, ONNX, 1, &[1, 1, 12, 12]),
        (COLOUR, opponent, 3, &[0, 3, 12, 12]),
        (COLOUR, opponent, 3, &[0, 0, 0, 0]),
    ] {
        let raw = check(retina, "{ kind = \"raw\", standardise = false }", &[]).expect("a raw encoder");
        let onnx = check(retina, kind, &identity(sides)).expect("a network that fits");
        let wanted = track(&raw, planes, 1);
        assert_eq!(wanted, track(&onnx, planes, 1), "{retina} {sides:?}");
        assert_eq!(wanted, track(&onnx, planes, 3), "{retina} {sides:?}, three threads");
    }
}

/// A deep network tracks, and its threads change nothing.
#[test]
fn deep_features_track() {
    for (retina, planes) in [("rings = [[32, 1]]", 1), ("rings = [[32, 1]], colour = [[32, 1]]", 3)] {
        let hedge = check(retina, ONNX, &deep(3)).expect("a network that fits");
        let config = hedge.config().clone().with_policy("fixed").expect("a policy");
        let blueprint = config.check(&File(deep(3))).expect("a network that fits");
        let one = track(&blueprint, planes, 1);
        assert_eq!(one, track(&blueprint, planes, 2), "threads");
        let overlap = one.iter().enumerate().map(|(t, b)| b.iou(&truth(t + 1))).sum::<f64>() / one.len() as f64;
        assert!(overlap > 0.6, "{overlap}");
    }
}

/// Red, green and blue as the picture has them, where the retina reads whole pixels; less a mean, over a deviation. A retina without
/// colour feeds its grey to three planes.
#[test]
fn planes_are_red_green_and_blue() {
    let retina = || {
        let config = FovealConfig { side: 24.0, rings: vec![[24, 2]], colour: vec![[24, 2]] };
        Foveal::new(config).expect("whole cells")
    };
    let kind = "{ kind = \"onnx\", model = \"a.onnx\", mean = [0.1, 0.2, 0.3], std = [0.5, 2, 4] }";
    let encoder = encoder(COLOUR, kind, &identity(&[0, 3, 12, 12]));
    let [r, g, b] = [200u8, 40, 120];
    let grey = (0.299 * f32::from(r) + 0.587 * f32::from(g) + 0.114 * f32::from(b)) / 255.0;
    let about = |x: f32| (x + 128.0) / 255.0;
    let (red_green, blue_yellow) = (about((f32::from(r) - f32::from(g)) / 2.0), about(0.0));
    let n = retina().glimpse_len() / 3;
    let glimpse = [vec![grey; n], vec![red_green; n], vec![blue_yellow; n]].concat();
    let h = features(&*encoder, &glimpse);
    for (k, (value, (mean, std))) in [r, g, b].into_iter().zip([(0.1, 0.5), (0.2, 2.0), (0.3, 4.0)]).enumerate() {
        let wanted = (f32::from(value) / 255.0 - mean) / std;
        assert!(h[k * n..][..n].iter().all(|h| (h - wanted).abs() < 1e-4), "plane {k}: {}, not {wanted}", h[k * n]);
    }
    let kind = "{ kind = \"onnx\", model = \"a.onnx\", mean = [0.5], std = [0.25] }";
    let grey = features(&*self::encoder(ONE, kind, &identity(&[0, 3, 12, 12])), &[0.75; 144]);
    assert!(grey.len() == 3 * 144 && grey.iter().all(|h| *h == 1.0), "{grey:?}");
}

/// Glimpses that meet each other in a network are given to it one by one, where the file leaves the batch open.
#[test]
fn glimpses_do_not_meet() {
    let mixing = |batch| {
        Network::new(&[batch, 144], &[batch, 144])
            .node("ReduceMean", &["x"], "m", &[Attribute::Ints("axes", &[0]), Attribute::Int("keepdims", 1)])
            .node("Sub", &["x", "m"], "d", &[])
            .node("Add", &["d", "x"], "y", &[])
            .file()
    };
    // Alone, a glimpse is its own mean.
    let v = glimpses(5, 144);
    assert_eq!(features(&*encoder(ONE, ONNX, &mixing(0)), &v), v);
    let message = said(check(ONE, ONNX, &mixing(4)));
    assert!(
        message.contains("a.onnx") && message.contains("beside it") && message.contains("model.eval()"),
        "{message}"
    );
}

/// The file of a model is read as any other is, and the error of one that does not fit names both sides.
#[test]
fn misfits_are_errors() {
    let says = |retina: &str, kind: &str, file: &[u8], parts: &[&str]| {
        let message = said(check(retina, kind, file));
        for part in parts.iter().chain(&["a.onnx"]) {
            assert!(message.contains(part), "{message:?} has no {part:?}");
        }
    };
    let fits_not = ["(N, 3, 32, 32)", "does not fit", "rings = [[32, 1]], colour = [[32, 1]]"];
    says(RINGS, ONNX, &deep(3), &fits_not);
    says(COLOUR, ONNX, &deep(3), &fits_not);
    says(COLOUR, ONNX, &identity(&[0, 1, 12, 12]), &["(N, 1, 12, 12)", "rings = [[12, 1]]"]);
    says(RINGS, ONNX, &linear(0, 131, 3, &numbers(393, 1), &[0.0; 3]), &["(N, 131)", "132 values", "(N, 132)"]);
    says(ONE, ONNX, &identity(&[144]), &["(144)", "(N, 144)"]);
    says(
        ONE,
        ONNX,
        &Network::of(7, &[0, 144], &[0, 144]).node("Identity", &["x"], "y", &[]).file(),
        &["I64", "32-bit floats"],
    );
    let whole = Network::new(&[0, 144], &[144]).node("ReduceSum", &["x"], "y", &[Attribute::Int("keepdims", 0)]);
    says(ONE, ONNX, &whole.file(), &["its output is ()", "one row of features for each"]);
    let two = "{ kind = \"onnx\", model = \"a.onnx\", mean = [0.5, 0.5] }";
    let message = said(check(ONE, two, &identity(&[0, 1, 12, 12])));
    assert!(message.contains("encoder.mean has 2 numbers") && message.contains("1 planes"), "{message}");
    let zero = "{ kind = \"onnx\", model = \"a.onnx\", std = [0] }";
    let message = said(check(ONE, zero, &identity(&[0, 1, 12, 12])));
    assert!(message.contains("encoder.std is a number from"), "{message}");
    let none = Config::parse(
        "particles = 9\ndynamics = { kind = \"autoregressive\" }\nencoder = { kind = \"onnx\", model = \"a.onnx\" }\n\
         likelihood = { distance = \"cosine\", sharpness = 1 }\npolicy = { kind = \"fixed\" }\n",
        "test",
    );
    let message = said(none.expect("it parses").check(&File(identity(&[0, 9]))));
    assert!(message.contains("needs a retina"), "{message}");
    let missing = check(ONE, "{ kind = \"raw\" }", &[]).expect("a raw encoder");
    let config =
        missing.config().clone().set("encoder={ kind = \"onnx\", model = \"no/such.onnx\" }").expect("a setting");
    let message = config.check(&Nowhere).map(drop).expect_err("no such file").to_string();
    assert!(message.contains("no/such.onnx: cannot read"), "{message}");
}

/// Weights that are no numbers are refused; numbers that overflow only for some glimpses become a row of zeros.
#[test]
fn numbers_that_are_none_stay_out() {
    for bad in [f32::NAN, f32::INFINITY] {
        let message = said(check(ONE, ONNX, &linear(0, 144, 2, &[bad; 288], &[0.0; 2])));
        assert!(message.contains("not finite"), "{message}");
    }
    // The root of 1.5 less each value.
    let network = Network::new(&[0, 144], &[0, 144])
        .floats("most", &[1], &[1.5])
        .node("Sub", &["most", "x"], "d", &[])
        .node("Sqrt", &["d"], "y", &[])
        .file();
    let encoder = encoder(ONE, ONNX, &network);
    let mut glimpses = vec![0.5; 3 * 144];
    glimpses[144 + 7] = 2.0;
    let h = features(&*encoder, &glimpses);
    let rows: BTreeSet<bool> = h[144..288].iter().map(|x| *x == 0.0).collect();
    assert!(rows == BTreeSet::from([true]) && h[..144].iter().chain(&h[288..]).all(|x| *x == 1.0), "{h:?}");
}
