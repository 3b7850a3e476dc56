//! Tests of links, linked as one program instead of 6.

mod clients;
mod equal;
mod greetings;
mod precision;
mod strangers;
mod support;
