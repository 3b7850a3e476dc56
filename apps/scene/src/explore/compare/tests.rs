//! The default against a run of the program, and what is known of alternations.

use super::case::Case;
use super::method::couple;
use crate::scene::Scene;
use crate::setup;
use crate::spec::Method;

fn example(name: &str) -> String {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/compare");
    std::fs::read_to_string(format!("{folder}/{name}.toml")).unwrap()
}

fn case(scene: &Scene) -> Case {
    Case::new(scene.spec(), scene.folder(), &mut |_, _, _| ()).unwrap()
}

/// The board's default is the program's own scheme: the same steps to round-off, of a run with four own
/// steps. One pulse begins in the overlap, so that the first half reflection counts.
#[test]
fn the_default_makes_the_steps_of_a_run() {
    for (word, lumped, centre) in [(Method::Arlequin, false, 0.29), (Method::Lumped, true, 0.2)] {
        let wave =
            format!("component = \"x\", along = \"x\", centre = {centre}, width = 0.1, amplitude = 1e-6");
        let text = example("bar-1d") + &format!("\n[[initial]]\nwave = {{ {wave} }}\n");
        let scene = Scene::from_text(text).unwrap();
        let scene = scene.set("interface.joint.lumped", lumped).unwrap();
        let mut own = couple(&mut case(&scene), word, 1.0).unwrap();
        let pace = own.state().pace;
        assert_eq!(pace.own, 4);
        // The critical steps agree to the tolerance of their iterations; bits of the step are those of
        // the board.
        let scene = scene.set("time.step.seconds", pace.step).unwrap();
        let scene = scene.set("model.chain.step.ratio", 4).unwrap();
        let mut run = setup::build(scene.spec(), scene.folder()).unwrap().run;
        assert!((pace.step / run.dt() - 1.0).abs() < 1e-12);
        let sides = run.interfaces()[0].sides();
        let state = |run: &arlequin::core::Coupled<f64>| {
            let states = sides.map(|s| run.subdomains()[s].state());
            [states.map(|s| &*s.q).concat(), states.map(|s| &*s.v).concat()]
        };
        let [q, v] = state(&run);
        own.reset(&q, &v);
        for _ in 0..200 {
            run.advance(&mut arlequin::core::Silent).unwrap();
            own.advance();
        }
        let now = &own.state().now;
        for (mine, wanted) in [&now.q, &now.v].into_iter().zip(&state(&run)) {
            let top = wanted.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            let off = mine.iter().zip(wanted).map(|(a, b)| (a - b).abs());
            let off = off.fold(0.0, f64::max);
            assert!(top > 0.0 && off < 1e-8 * top, "{word:?}: {off:e} of {top:e}");
        }
    }
}

/// The cantilever of Norma.jl (Sandia), released from a bent shape: its alternation changed the energy by
/// −91 to +275 % in 1 ms, by mesh ratio and overlap.
#[test]
fn alternation_changes_the_energy_of_a_cantilever() {
    let mut range = [f64::INFINITY, f64::NEG_INFINITY];
    for (ratio, width) in [0.8, 0.6, 0.4]
        .map(|r| [50.8e-3, 25.4e-3, 12.7e-3].map(|w| (r, w)))
        .concat()
    {
        let [low, high] = [0.127 - width / 2.0, 0.127 + width / 2.0];
        let text = example("cantilever")
            .replace("high = [0.5588, ", &format!("high = [{high}, "))
            .replace("low = [0.508, ", &format!("low = [{low}, "))
            .replace("high = [1.016, ", "high = [0.254, ")
            .replace("coarse = [0.508, ", &format!("coarse = [{low}, "))
            .replace("fine = [0.5588, ", &format!("fine = [{high}, "))
            .replacen("spacing = 12.7e-3", &format!("spacing = {}", 6.35e-3 / ratio), 1);
        let mut case = case(&Scene::from_text(text).unwrap());
        let mut q = Vec::new();
        for part in &mut case.parts[..2] {
            for (i, p) in part.places.iter().enumerate() {
                let x = low + p.x;
                q.push(if i % 3 == 1 { 0.393_701 * x * x } else { 0.0 });
                // Without a mass that counts, the clamped nodes do not move.
                if x.abs() < 1e-9 {
                    part.full[i] = f64::INFINITY;
                }
            }
        }
        let mut drift = |word| {
            let mut coupling = couple(&mut case, word, 1.0).unwrap();
            coupling.reset(&q, &vec![0.0; q.len()]);
            let start = coupling.energy();
            (0..(1e-3 / coupling.state().pace.step) as usize).for_each(|_| coupling.advance());
            (start, coupling.energy() / start - 1.0)
        };
        let ((start, schwarz), (_, own)) = (drift(Method::Schwarz), drift(Method::Arlequin));
        let published = (start / 1506.5 - 1.0).abs();
        assert!(published < 0.01, "at the start 1506.5 J, not {start}");
        assert!(own.abs() < 1e-10, "1:{ratio}, {width}: {own}");
        assert!(schwarz.abs() > 0.03, "1:{ratio}, {width}: {schwarz}");
        range = [range[0].min(schwarz), range[1].max(schwarz)];
    }
    let [loss, gain] = range;
    assert!(loss < -0.03 && gain > 1.0 && gain < 2.75, "{range:?}");
}
