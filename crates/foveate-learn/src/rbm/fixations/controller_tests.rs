//! Larochelle & Hinton's synthetic task (2010, section 6.2): the symbol in the middle gives the place to look.
//!
//! 48 images of 15 × 15: in the middle one of eight symbols, in the region it stands for (of the eight around, 5 × 5
//! each) a bar of three pixels, level or upright, in one of three positions each. The class is the bar's direction. A
//! fixation sees one region; the glimpse of the middle chooses the place and is then dropped.

use super::*;
use crate::training::Training;
use foveate_base::rng::{Purpose, Streams};
use foveate_base::rows::Rows;

const REGION: usize = 25;
/// Which pixels of a 3 × 3 square each symbol has.
const SYMBOLS: [u16; 8] = [0o272, 0o525, 0o757, 0o111, 0o444, 0o700, 0o007, 0o124];

/// The nine regions of every image, 48 × 9 × 25 values, and the classes.
fn images() -> (Vec<f32>, Vec<u8>) {
    let (mut x, mut y) = (vec![], vec![]);
    let around = [0, 1, 2, 3, 5, 6, 7, 8];
    for (symbol, &region) in SYMBOLS.iter().zip(&around) {
        for bar in 0..6 {
            let mut image = [[0.0f32; REGION]; 9];
            for i in 0..9 {
                let pixel = (1 + i / 3) * 5 + 1 + i % 3;
                image[4][pixel] = f32::from(symbol >> i & 1);
                let (row, column) = (i / 3, i % 3);
                let on = if bar < 3 { row == bar } else { column == bar - 3 };
                image[region][pixel] = f32::from(u8::from(on));
            }
            x.extend(image.as_flattened());
            y.push(u8::from(bar < 3));
        }
    }
    (x, y)
}

/// Learns both at once, and answers how many images were fixated elsewhere than at their bar, and how many were
/// misread.
fn errors(alpha: f32, epochs: usize) -> (usize, usize) {
    let (x, y) = images();
    let region = |image: usize, place: usize| &x[(image * 9 + place) * REGION..][..REGION];
    let recipe = Recipe {
        hidden: 100,
        factors: 50,
        alpha,
        epochs,
        batch: 48,
        rate: 0.01,
        l2: 0.0,
        average: 0.9,
        ..Recipe::new(Cost::Hybrid, 1, 2, Places::grid(3, 1.0).expect("nine places"))
    };
    let mut controller = Controller::new(recipe.hidden, recipe.places.len()).expect("hidden units and places");
    let mut trainer: Option<Trainer> = None;
    let middle = [Code::one_hot(4); 48];
    let middles: Vec<f32> = (0..48).flat_map(|i| region(i, 4)).copied().collect();
    let seen = [false; 9];
    for epoch in 0..epochs {
        let mut rng = Streams::new(1, 0).at(epoch as u64, Purpose::Recognize).rng(0);
        let rbm = trainer.as_ref().map(|t| t.learned().expect("finite"));
        let s = rbm.as_ref().map(|rbm| rbm.hidden_probabilities(Rows::new(&middles, REGION), &middle, 1));
        let draw = |i: usize, controller: &Controller, rng: &mut foveate_base::rng::Rng| {
            let s = s.as_ref().map_or(&[0.0; 100][..], |s| &s[i * 100..][..100]);
            controller.draw(s, &seen, rng).expect("nine places to choose from")
        };
        // Four fixations of each image, drawn by the controller.
        let drawn: Vec<usize> = (0..4 * 48).map(|i| draw(i / 4, &controller, &mut rng)).collect();
        let glimpses: Vec<f32> = drawn.iter().enumerate().flat_map(|(i, &a)| region(i / 4, a)).copied().collect();
        let codes: Vec<Code> = drawn.iter().map(|&a| Code::one_hot(a)).collect();
        let labels: Vec<u8> = (0..4 * 48).map(|i| y[i / 4]).collect();
        let data = Sequences::new(Rows::new(&glimpses, REGION), &codes, &labels, 1).expect("they fit");
        if let (Some(rbm), Some(s)) = (&rbm, &s) {
            let log_p = rbm.log_posterior(data.glimpses(), &codes, 1);
            for (i, &a) in drawn.iter().enumerate() {
                let log_p = log_p[i * 2 + usize::from(labels[i])] as f32;
                controller.learn(&s[i / 4 * 100..][..100], &seen, a, log_p, 0.003);
            }
        }
        let trainer = trainer.get_or_insert_with(|| Trainer::new(recipe.clone(), data).expect("they fit"));
        trainer.epoch(data);
    }
    let rbm = trainer.expect("there were epochs").learned().expect("finite");
    let s = rbm.hidden_probabilities(Rows::new(&middles, REGION), &middle, 1);
    let (mut elsewhere, mut misread) = (0, 0);
    for i in 0..48 {
        let place = controller.best(&s[i * 100..][..100], &seen).expect("nine places");
        let log_p = rbm.log_posterior(Rows::new(region(i, place), REGION), &[Code::one_hot(place)], 1);
        elsewhere += usize::from(region(i, place).iter().sum::<f32>() != 3.0 || place == 4);
        misread += usize::from(log_p[usize::from(y[i])] <= 0.5f64.ln());
    }
    (elsewhere, misread)
}

#[test]
fn the_controller_finds_the_bar_from_the_symbol() {
    assert_eq!(errors(1.0, 400), (0, 0));
    // Without the generative part nothing teaches the hidden units the symbols, which have no class.
    let (elsewhere, misread) = errors(0.0, 400);
    assert!(elsewhere >= 6 && misread >= 3, "{elsewhere} fixated elsewhere, {misread} misread");
}

#[test]
fn no_place_is_chosen_twice() {
    let controller = Controller::new(3, 4).expect("hidden units and places");
    let mut rng = Streams::new(3, 0).rng(0);
    let mut seen = [false; 4];
    for left in (0..4).rev() {
        assert!(!seen[controller.best(&[0.5; 3], &seen).expect("one is left")]);
        let place = controller.draw(&[0.5; 3], &seen, &mut rng).expect("one is left");
        assert!(!std::mem::replace(&mut seen[place], true));
        assert_eq!(seen.iter().filter(|s| !**s).count(), left);
    }
    assert!(controller.best(&[0.5; 3], &seen).is_none() && controller.draw(&[0.5; 3], &seen, &mut rng).is_none());
    assert_eq!(controller.places(), 4);
}
