//! Errors on the terminal, with the line of the scene file that caused them.

pub(crate) use arlequin_scene::error::*;

use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};
use arlequin_scene::Source;
use std::process::ExitCode;

/// An error and the file text it may point to.
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
    /// Returns a function that attaches the text of a scene to an error.
    pub(crate) fn within(source: &Source) -> impl FnOnce(Error) -> Self {
        let source = Some(Box::new(source.clone()));
        |error| Self { error, source }
    }

    /// Prints the error and returns the exit code.
    pub(crate) fn report(&self) -> ExitCode {
        crate::report::error(&render(&self.error, self.source.as_deref()));
        self.code()
    }

    /// Returns the exit code: 130 if interrupted, 2 for wrong input, 1 otherwise.
    pub(crate) fn code(&self) -> ExitCode {
        ExitCode::from(match self.error.is_input() {
            _ if crate::run::is_interrupted() => crate::run::INTERRUPTED,
            true => 2,
            false => 1,
        })
    }
}

/// Errors of runs on several ranks.
#[cfg(feature = "mpi")]
impl Located {
    /// Returns whether all ranks have received this error.
    pub(crate) fn is_everywhere(&self) -> bool {
        self.error.is_everywhere()
    }

    /// Prints an error known to all ranks on one rank only: the rank where it arose, or rank 0 if all had
    /// the same. Returns the exit code.
    pub(crate) fn report_once(&self) -> ExitCode {
        let is_origin = match self.error {
            Error::Agreed(_) => true,
            Error::Elsewhere { .. } => false,
            _ => crate::ranks::leads(),
        };
        if is_origin { self.report() } else { self.code() }
    }

    /// Returns the error on one line, to be sent to other ranks.
    pub(crate) fn plain(&self) -> String {
        self.error.to_string()
    }
}

/// Formats an error with the line of the scene file that caused it.
fn render(error: &Error, source: Option<&Source>) -> String {
    let (key, span) = error.place();
    let span = span.or_else(|| source.and_then(|s| s.span_of(key?)));
    let message = error.to_string();
    let title = Level::ERROR.primary_title(&message);
    let rendered = match (source, span) {
        (Some(s), Some(span)) => {
            let annotation = AnnotationKind::Primary.span(span).label(key);
            let path = s.path.display().to_string();
            let lines = Snippet::source(&s.text).path(path).annotation(annotation);
            Renderer::plain().render(&[title.element(lines)])
        }
        _ => Renderer::plain().render(&[Group::with_title(title)]),
    };
    rendered + "\n"
}
