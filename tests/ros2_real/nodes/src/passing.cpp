// Passes each text of in on to out, with its length in front; a long one is cut.
#include <memory>
#include <string>
#include <utility>

#include <rclcpp/rclcpp.hpp>
#include <rclcpp_components/register_node_macro.hpp>
#include <std_msgs/msg/string.hpp>

namespace bagpipe_nodes {

using std_msgs::msg::String;

class Passing : public rclcpp::Node {
public:
  explicit Passing(const rclcpp::NodeOptions &options) : Node("passing", options) {
    out_ = create_publisher<String>("out", rclcpp::QoS(1000));
    rclcpp::QoS qos(declare_parameter("depth", 10));
    in_ = create_subscription<String>("in", qos, [this](String::UniquePtr message) {
      auto passed = std::make_unique<String>();
      passed->data = std::to_string(message->data.size()) + " " + message->data.substr(0, 80);
      out_->publish(std::move(passed));
    });
  }

private:
  rclcpp::Publisher<String>::SharedPtr out_;
  rclcpp::Subscription<String>::SharedPtr in_;
};

}  // namespace bagpipe_nodes

RCLCPP_COMPONENTS_REGISTER_NODE(bagpipe_nodes::Passing)
