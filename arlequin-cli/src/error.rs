//! Errors on the terminal: with the place in the scene they come from.

pub(crate) use arlequin_scene::error::*;

/// Shows an error with the place in the scene it comes from.
pub(crate) fn render(error: &Error, source: Option<&arlequin_scene::Source>) -> String {
    if let Error::Sweep { text, .. } = error {
        return text.clone();
    }
    let (key, span) = error.place();
    let span = span.or_else(|| source.and_then(|s| s.span_of(key?)));
    let mut report = miette::MietteDiagnostic::new(error.to_string());
    if let Some(span) = &span {
        let label = miette::LabeledSpan::at(span.clone(), key.unwrap_or("here"));
        report = report.with_label(label);
    }
    let mut out = String::new();
    let theme = miette::GraphicalTheme::unicode_nocolor();
    let handler = miette::GraphicalReportHandler::new_themed(theme)
        .with_context_lines(1)
        .with_wrap_lines(false)
        .without_cause_chain();
    let shown = match (source, span) {
        (Some(s), Some(_)) => {
            let text = miette::NamedSource::new(s.path.display().to_string(), s.text.clone());
            let report = miette::Report::new(report).with_source_code(text);
            handler.render_report(&mut out, report.as_ref())
        }
        _ => handler.render_report(&mut out, &report),
    };
    if shown.is_ok() { out } else { format!("{error}\n") }
}
