//! The agent: one static binary that is put into any image of ROS 1 or ROS 2, plays recordings
//! into the user's stack, records what it answers, and supervises it. It meets Spark at a pair of
//! named pipes for each slot; docs/reference/binpipe.md is what they say.

mod case;
mod cli;
mod engine;
mod formats;
mod metrics;
mod serve;
mod size;
mod stack;
mod verbs;

use std::process::ExitCode;

use clap::Parser;

use crate::serve::{layout, slot};
use crate::verbs::{check, convert, hello, info, install, merge, play, record, reindex, slice};

fn main() -> ExitCode {
    let outcome = match cli::Cli::parse().verb {
        cli::Verb::Install { directory } => install::install(&directory),
        cli::Verb::Serve(options) => serve::serve(&options),
        cli::Verb::Ready { shared, wait } => layout::Shared::new(&shared).await_ready(wait),
        cli::Verb::Info { file, memory } => info::info(&file, memory),
        cli::Verb::Play(options) => play::play(&options),
        cli::Verb::Record(options) => record::record(&options),
        cli::Verb::Slice(options) => slice::slice(&options),
        cli::Verb::Merge(options) => merge::merge(&options),
        cli::Verb::Reindex(options) => reindex::reindex(&options),
        cli::Verb::Check(options) => check::check(&options),
        cli::Verb::Convert(options) => convert::convert(&options),
        cli::Verb::Hello => hello::hello(),
        cli::Verb::Maps { of } => engine::maps::maps(of),
        cli::Verb::Slot { slot, port, serve } => slot::run(&serve, slot, port),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("bagpipe-agent: {message}");
            ExitCode::FAILURE
        }
    }
}
