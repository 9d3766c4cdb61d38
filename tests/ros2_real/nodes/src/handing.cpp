// Two nodes for one process: Handing makes a text of each message of in and hands it over within the
// process on mid, and Handed publishes it on out with the time at which its callback was called.
#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <utility>

#include <rclcpp/rclcpp.hpp>
#include <rclcpp_components/register_node_macro.hpp>
#include <sensor_msgs/msg/imu.hpp>
#include <std_msgs/msg/string.hpp>

namespace bagpipe_nodes {

using sensor_msgs::msg::Imu;
using std_msgs::msg::String;

static rclcpp::NodeOptions within(rclcpp::NodeOptions options) {
  return options.use_intra_process_comms(true);
}

class Handing : public rclcpp::Node {
public:
  explicit Handing(const rclcpp::NodeOptions &options) : Node("handing", within(options)) {
    const std::chrono::microseconds work(declare_parameter("work_us", 0));
    mid_ = create_publisher<String>("mid", rclcpp::QoS(100));
    in_ = create_subscription<Imu>("in", rclcpp::QoS(10), [this, work](const Imu &message) {
      std::this_thread::sleep_for(work);
      auto text = std::make_unique<String>();
      text->data = std::to_string(rclcpp::Time(message.header.stamp).nanoseconds());
      mid_->publish(std::move(text));
    });
  }

private:
  rclcpp::Publisher<String>::SharedPtr mid_;
  rclcpp::Subscription<Imu>::SharedPtr in_;
};

class Handed : public rclcpp::Node {
public:
  explicit Handed(const rclcpp::NodeOptions &options) : Node("handed", within(options)) {
    const std::chrono::microseconds work(declare_parameter("work_us", 0));
    out_ = create_publisher<String>("out", rclcpp::QoS(1000));
    mid_ = create_subscription<String>("mid", rclcpp::QoS(100), [this, work](String::UniquePtr text) {
      const auto called = now().nanoseconds();
      std::this_thread::sleep_for(work);
      text->data += " " + std::to_string(called);
      out_->publish(std::move(text));
    });
  }

private:
  rclcpp::Publisher<String>::SharedPtr out_;
  rclcpp::Subscription<String>::SharedPtr mid_;
};

}  // namespace bagpipe_nodes

RCLCPP_COMPONENTS_REGISTER_NODE(bagpipe_nodes::Handing)
RCLCPP_COMPONENTS_REGISTER_NODE(bagpipe_nodes::Handed)
