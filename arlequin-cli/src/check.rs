//! `arlequin check`: builds everything, prints what the run will be, runs nothing.

use crate::error::Result;
use crate::report;
use arlequin_scene::Scene;
use arlequin_scene::output::json;

/// Checks a scene.
pub(crate) fn check(scene: &Scene, as_json: bool) -> Result<()> {
    let preview = scene.prepare()?.preview();
    if as_json {
        report::json(&json("writing the plan", &preview)?);
    } else {
        report::plan(&preview);
    }
    Ok(())
}
