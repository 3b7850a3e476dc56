//! Errors on the terminal: with the place in the scene they come from.

pub(crate) use arlequin_scene::error::*;

use arlequin_scene::Source;
use std::process::ExitCode;

/// An error and the text it may point into.
#[derive(Debug)]
pub(crate) struct Located {
    error: Error,
    source: Option<Box<Source>>,
}

impl From<Error> for Located {
    fn from(error: Error) -> Self {
        Self { error, source: None }
    }
}

impl Located {
    /// Points into a text.
    pub(crate) fn within(source: &Source) -> impl FnOnce(Error) -> Self {
        let source = Some(Box::new(source.clone()));
        |error| Self { error, source }
    }

    /// Shows the error; the code to exit with.
    pub(crate) fn report(&self) -> ExitCode {
        crate::report::error(&render(&self.error, self.source.as_deref()));
        ExitCode::from(if self.error.is_input() { 2 } else { 1 })
    }
}

/// Shows an error with the place in the scene it comes from.
fn render(error: &Error, source: Option<&Source>) -> String {
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
