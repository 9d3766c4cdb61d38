//! What the verbs that join a running graph have in common.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use bagpipe_graph::Middleware;
use bagpipe_ros1::Ros1;
use signal_hook::consts::{SIGINT, SIGTERM};

/// The graph of the master whose URI is given, or that ROS gives.
pub fn graph(master_uri: Option<&str>) -> Result<Arc<dyn Middleware>, String> {
    let uri = master_uri.map(str::to_owned).or_else(|| std::env::var("ROS_MASTER_URI").ok());
    let master_uri = uri.filter(|uri| !uri.is_empty()).ok_or_else(|| {
        "which ROS master? Set ROS_MASTER_URI, such as http://localhost:11311, or --master"
            .to_owned()
    })?;
    Ok(Arc::new(Ros1 { master_uri }))
}

/// A flag that Ctrl-C and SIGTERM raise.
pub fn interrupted() -> Result<Arc<AtomicBool>, String> {
    let flag = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&flag))
            .map_err(|error| format!("signal {signal} can't be handled: {error}"))?;
    }
    Ok(flag)
}

/// Parses seconds, at least 0.
pub fn seconds(text: &str) -> Result<Duration, String> {
    let number: f64 = text.parse().map_err(|error| format!("{text:?}: {error}"))?;
    Duration::try_from_secs_f64(number).map_err(|error| format!("{text:?}: {error}"))
}

/// Parses a number above 0.
pub fn positive(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|error| format!("{text:?}: {error}"))?;
    let good = number.is_finite() && number > 0.0;
    good.then_some(number).ok_or_else(|| format!("{text} is not above 0"))
}
