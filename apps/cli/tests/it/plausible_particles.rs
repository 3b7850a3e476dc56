//! Warnings of strengths, coordinations and checks of bonds that are hardly meant.

use crate::common::scratch;
use crate::plausible::warnings;

#[test]
fn strengths_far_outside_any_solid_are_named() {
    let folder = scratch("strength");
    let bar = r#"
[model.bar]
kind = "dem"
shape.box = { low = [0.0, 0.0, 0.0], high = [8e-3, 4e-3, 4e-3] }
dem = { count = 200, protocol = "quench" }
material = { young = 75e9, poisson = 0.17, density = 2200.0 }
[[effect]]
fracture = { criterion = "rankine", strength = 200e6 }
[time]
end = 5e-6
"#;
    let odd = |sets: &[&str]| -> Vec<String> {
        let texts = warnings(&folder, bar, sets);
        texts
            .into_iter()
            .filter(|w| w.contains("effect[0].fracture: strength"))
            .collect()
    };
    assert_eq!(odd(&[]), [""; 0]);
    for (set, words) in [
        (
            "effect.0.fracture.strength=200",
            "strength = 2e2 is 2.67e-9 of Young's modulus, far below",
        ),
        ("effect.0.fracture.strength=200e12", "far above"),
        (
            "effect.0.fracture={criterion='energy', strength=1e-6}",
            "strength = 1e-6 is 1.00e-6 J/m², far below",
        ),
        // A stress in Pa where an energy is meant.
        (
            "effect.0.fracture={criterion='energy', strength=100e6}",
            "strength = 1e8 is 1.00e8 J/m², far above",
        ),
        (
            "effect.0.fracture={criterion='hydrostatic', strength=15.0}",
            "strength = 1.5e1 is 2.00e-10 of Young's modulus, far below",
        ),
        (
            "effect.0.fracture={gc=8.0, softening=true, strength=1e-3}",
            "strength = 1e-3 is 1.33e-14 of Young's modulus, far below",
        ),
    ] {
        let odd_texts = odd(&[set]);
        assert!(
            odd_texts.len() == 1 && odd_texts[0].contains(words),
            "{set}: {odd_texts:#?}"
        );
    }
}

/// A bar of spheres with these keys of its packing, and its fracture.
fn brittle(dem: &str, fracture: &str) -> String {
    format!(
        "[model.bar]\nkind = \"dem\"\nshape.box = {{ low = [0.0, 0.0, 0.0], high = [8e-3, 4e-3, 4e-3] }}\n\
         dem = {{ count = 200, protocol = \"quench\"{dem} }}\n\
         material = {{ young = 75e9, poisson = 0.17, density = 2200.0 }}\n{fracture}[time]\nsteps = 5\n"
    )
}

#[test]
fn coordinations_without_measured_beams_are_named() {
    let folder = scratch("coordination");
    let gc = "[[effect]]\nfracture = { gc = 8.0 }\n";
    let odd = |dem: &str, fracture: &str| -> Vec<String> {
        let texts = warnings(&folder, &brittle(dem, fracture), &[]);
        texts.into_iter().filter(|w| w.contains("coordination")).collect()
    };
    for (dem, fracture, words) in [
        ("", "", ""),
        (", coordination = 6.25", "", ""),
        (", coordination = 6.7", "", "some 11 % stiffer than"),
        (", coordination = 5.7", "", "some 11 % softer than"),
        (
            ", coordination = 5.7",
            gc,
            "softer than material.young says, and what a strength or gc makes",
        ),
        (", coordination = 5.7, young = 2e11", "", ""),
        (
            ", coordination = 5.7, young = 2e11",
            gc,
            "so that what a strength or gc makes",
        ),
    ] {
        let texts = odd(dem, fracture);
        let good = texts.iter().all(|t| !words.is_empty() && t.contains(words));
        assert!(
            good && texts.len() == usize::from(!words.is_empty()),
            "{dem} {fracture}: {texts:#?}"
        );
    }
}

#[test]
fn bonds_that_are_never_checked_are_named() {
    let folder = scratch("never-checked");
    let odd = |every: usize| -> usize {
        let fracture = format!("[[effect]]\nfracture = {{ gc = 8.0, every = {every} }}\n");
        let texts = warnings(&folder, &brittle("", &fracture), &[]);
        texts.iter().filter(|w| w.contains("no bond is checked")).count()
    };
    assert_eq!([odd(1), odd(5), odd(6)], [0, 0, 1]);
}
