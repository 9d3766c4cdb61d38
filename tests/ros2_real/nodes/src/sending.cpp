// Once a message of in has come, publishes many texts on out, at a rate. Its queue is one of ten.
#include <chrono>
#include <string>
#include <thread>

#include <rclcpp/rclcpp.hpp>
#include <rclcpp_components/register_node_macro.hpp>
#include <std_msgs/msg/string.hpp>

namespace bagpipe_nodes {

using std_msgs::msg::String;

class Sending : public rclcpp::Node {
public:
  explicit Sending(const rclcpp::NodeOptions &options) : Node("sending", options) {
    messages_ = declare_parameter("messages", 1000);
    pause_ = std::chrono::nanoseconds(1'000'000'000 / declare_parameter("rate", 1000));
    text_.data = std::string(declare_parameter("bytes", 1000), 'x');
    out_ = create_publisher<String>("out", rclcpp::QoS(10));
    in_ = create_subscription<String>("in", rclcpp::QoS(10), [this](const String &) { send(); });
  }

private:
  void send() {
    auto due = std::chrono::steady_clock::now();
    for (int64_t sent = 0; sent < messages_; sent++) {
      out_->publish(text_);
      due += pause_;
      // What a sleep is too coarse for goes out in bursts, as many at a time as are due.
      if (due > std::chrono::steady_clock::now()) std::this_thread::sleep_until(due);
    }
  }

  int64_t messages_;
  std::chrono::nanoseconds pause_;
  String text_;
  rclcpp::Publisher<String>::SharedPtr out_;
  rclcpp::Subscription<String>::SharedPtr in_;
};

}  // namespace bagpipe_nodes

RCLCPP_COMPONENTS_REGISTER_NODE(bagpipe_nodes::Sending)
