// Publishes what it was configured with once, for who comes late (transient local), and answers each
// text of in, which is transient local too, on out.
#include <string>

#include <rclcpp/rclcpp.hpp>
#include <rclcpp_components/register_node_macro.hpp>
#include <std_msgs/msg/string.hpp>

namespace bagpipe_nodes {

using std_msgs::msg::String;

class Keeping : public rclcpp::Node {
public:
  explicit Keeping(const rclcpp::NodeOptions &options) : Node("keeping", options) {
    const auto kept = rclcpp::QoS(1).transient_local();
    settings_ = create_publisher<String>("settings", kept);
    out_ = create_publisher<String>("out", rclcpp::QoS(1000));
    in_ = create_subscription<String>("in", kept, [this](const String &message) {
      out_->publish(message);
    });
    String text;
    text.data = declare_parameter("settings", std::string("none"));
    settings_->publish(text);
  }

private:
  rclcpp::Publisher<String>::SharedPtr settings_, out_;
  rclcpp::Subscription<String>::SharedPtr in_;
};

}  // namespace bagpipe_nodes

RCLCPP_COMPONENTS_REGISTER_NODE(bagpipe_nodes::Keeping)
