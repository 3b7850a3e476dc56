//! Bonds of an overlap bear the loads that they have in a body of particles alone (decision 0022).

use arlequin::core::Profile;
use arlequin_studies::strain::{Bar, Pair};

/// Returns the largest bond load in the overlap over the largest load of the same bonds without elements.
fn hardest(pairs: &[Pair]) -> f64 {
    let top = |f: &dyn Fn(&Pair) -> f64| pairs.iter().map(f).fold(0.0, f64::max);
    top(&|p| p.coupled) / top(&|p| p.alone)
}

/// Returns the root mean square of the loads over those without elements, in the outermost twentieth of the
/// overlap.
fn skin(pairs: &[Pair]) -> f64 {
    let outer = || pairs.iter().filter(|p| p.s > 0.95);
    let square = |f: &dyn Fn(&Pair) -> f64| outer().map(|p| f(p).powi(2)).sum::<f64>();
    (square(&|p| p.coupled) / square(&|p| p.alone)).sqrt()
}

fn with_defaults() -> Bar {
    Bar {
        fine_epsilon: 0.1,
        absorber: 0.2,
        ..Bar::default()
    }
}

#[test]
fn at_rest_the_skin_of_an_overlap_is_over_strained_by_a_vanishing_weight_of_any_shape_and_not_with_the_floor()
{
    for profile in [Some(Profile::Cubic), Some(Profile::Linear), None] {
        let bar = Bar {
            profile: profile.clone(),
            ..Bar::default()
        };
        let pairs = bar.at_rest().unwrap();
        assert!(
            hardest(&pairs) > 2.0 && skin(&pairs) > 1.8,
            "{profile:?}: {} {}",
            hardest(&pairs),
            skin(&pairs)
        );
    }
    let pairs = with_defaults().at_rest().unwrap();
    assert!(hardest(&pairs) < 1.1, "hardest bond {}", hardest(&pairs));
    assert!((0.6..1.2).contains(&skin(&pairs)), "skin {}", skin(&pairs));
}

#[test]
fn under_a_shock_floor_and_absorber_keep_the_hardest_bond_of_an_overlap_within_a_fifth() {
    let before = Bar::default().under_a_shock(3.0).unwrap();
    assert!(hardest(&before) > 5.0, "hardest bond before {}", hardest(&before));
    let after = with_defaults().under_a_shock(3.0).unwrap();
    assert!(hardest(&after) < 1.2, "hardest bond {}", hardest(&after));
}

#[test]
fn one_mediator_element_across_an_overlap_is_not_cured_by_the_floor() {
    let bar = Bar {
        overlap: 5.0,
        ..with_defaults()
    };
    let pairs = bar.at_rest().unwrap();
    assert!(skin(&pairs) > 1.5, "skin {}", skin(&pairs));
}
