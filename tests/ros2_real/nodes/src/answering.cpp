// Answers each message of in on out. What the answer says depends on the message alone, and on
// simulated time where the node runs on it. It may be as long as a point cloud is, and be sent as such are.
#include <csignal>
#include <chrono>
#include <string>
#include <thread>

#include <rclcpp/rclcpp.hpp>
#include <rclcpp_components/register_node_macro.hpp>
#include <sensor_msgs/msg/imu.hpp>
#include <std_msgs/msg/string.hpp>

namespace bagpipe_nodes {

using sensor_msgs::msg::Imu;
using std_msgs::msg::String;

class Answering : public rclcpp::Node {
public:
  explicit Answering(const rclcpp::NodeOptions &options) : Node("answering", options) {
    copies_ = declare_parameter("copies", 1);
    work_ = std::chrono::microseconds(declare_parameter("work_us", 0));
    die_after_ = declare_parameter("die_after", 0);
    prefix_ = declare_parameter("prefix", std::string());
    bytes_ = declare_parameter("bytes", 0);
    gain_ = declare_parameter("gain", 1.0);
    rclcpp::QoS qos(declare_parameter("depth", 10));
    if (declare_parameter("best_effort", false)) qos.best_effort();
    rclcpp::SubscriptionOptions subscription;
    if (declare_parameter("reentrant", false)) {
      group_ = create_callback_group(rclcpp::CallbackGroupType::Reentrant);
      subscription.callback_group = group_;
    }
    rclcpp::QoS out(1000);
    if (declare_parameter("out_best_effort", false)) out.best_effort();
    out_ = create_publisher<String>("out", out);
    in_ = create_subscription<Imu>(
        "in", qos, [this](const Imu &message) { answer(message); }, subscription);
  }

private:
  void answer(const Imu &message) {
    if (die_after_ > 0 && ++seen_ > die_after_) std::raise(SIGKILL);
    if (work_.count() > 0) std::this_thread::sleep_for(work_);
    for (int64_t copy = 0; copy < copies_; copy++) {
      String answer;
      answer.data = prefix_ + std::to_string(rclcpp::Time(message.header.stamp).nanoseconds()) +
                    " " + std::to_string(gain_ * message.angular_velocity.z) + " " +
                    std::to_string(copy);
      if (get_parameter("use_sim_time").as_bool())
        answer.data += " " + std::to_string(now().nanoseconds());
      if (answer.data.size() < size_t(bytes_)) answer.data.resize(size_t(bytes_), '.');
      out_->publish(answer);
    }
  }

  int64_t copies_, die_after_, bytes_, seen_ = 0;
  std::chrono::microseconds work_;
  std::string prefix_;
  double gain_;
  rclcpp::CallbackGroup::SharedPtr group_;
  rclcpp::Publisher<String>::SharedPtr out_;
  rclcpp::Subscription<Imu>::SharedPtr in_;
};

}  // namespace bagpipe_nodes

RCLCPP_COMPONENTS_REGISTER_NODE(bagpipe_nodes::Answering)
