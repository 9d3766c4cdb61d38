//! ROS 1 behind the seam of `bagpipe-graph`.

use bagpipe_graph::{GraphError, Middleware, NodeOptions, ReadStamp, Sink, TopicInfo};

use crate::clock::{clock_frame, clock_topic};
use crate::{Node, RosError, stamp};

/// The graph of one master.
#[derive(Clone, Debug)]
pub struct Ros1 {
    /// Such as `http://127.0.0.1:11311`.
    pub master_uri: String,
}

impl Middleware for Ros1 {
    fn join(
        &self,
        options: NodeOptions,
        sink: Box<dyn Sink>,
    ) -> Result<Box<dyn bagpipe_graph::Node>, GraphError> {
        Ok(Box::new(Node::start(&self.master_uri, options, sink)?))
    }

    fn encoding(&self) -> &'static str {
        "ros1"
    }

    fn schema_encoding(&self) -> &'static str {
        "ros1msg"
    }

    fn read_stamp(&self, definition: &str) -> Option<ReadStamp> {
        stamp::reader(definition)
    }

    fn clock_topic(&self) -> TopicInfo {
        clock_topic()
    }

    fn clock_frame(&self, nanoseconds: u64) -> Vec<u8> {
        clock_frame(nanoseconds).to_vec()
    }
}

impl From<RosError> for GraphError {
    fn from(error: RosError) -> GraphError {
        GraphError {
            reason: "RosMasterFailed",
            what: "the ROS master failed",
            source: Box::new(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_of_the_client_is_one_of_the_master_with_the_same_words() {
        let graph = Ros1 { master_uri: "nowhere".to_owned() };
        let options = NodeOptions {
            name: "/a".to_owned(),
            call_deadline: std::time::Duration::from_secs(1),
            stall: std::time::Duration::from_secs(1),
            max_message: 1,
            paced_by: bagpipe_graph::PacedBy::default(),
        };
        struct Nobody;
        impl Sink for Nobody {
            fn message(&mut self, _: bagpipe_graph::Incoming<'_>) {}
            fn too_large(&mut self, _: &str, _: u64) {}
        }
        let error = graph.join(options, Box::new(Nobody)).err().unwrap();
        assert_eq!(error.reason, "RosMasterFailed");
        let text = error.to_string();
        assert!(
            text.starts_with("the ROS master failed: the URI \"nowhere\" can't be used"),
            "{text}"
        );
    }
}
