// A timer by the node's own clock, which is simulated where use_sim_time says so, publishes how many
// messages of in there were by then; its first tick is the first multiple of its period. Between its
// subscription and its timer it computes for starts_ms. With wall it is one of the machine's clock.
#include <chrono>
#include <string>

#include <rclcpp/rclcpp.hpp>
#include <rclcpp_components/register_node_macro.hpp>
#include <sensor_msgs/msg/imu.hpp>
#include <std_msgs/msg/string.hpp>

namespace bagpipe_nodes {

using sensor_msgs::msg::Imu;
using std_msgs::msg::String;

class Ticking : public rclcpp::Node {
public:
  explicit Ticking(const rclcpp::NodeOptions &options) : Node("ticking", options) {
    out_ = create_publisher<String>("tick", rclcpp::QoS(1000));
    in_ = create_subscription<Imu>("in", rclcpp::QoS(10), [this](const Imu &) { seen_++; });
    const auto starts = std::chrono::milliseconds(declare_parameter("starts_ms", 0));
    for (const auto begun = std::chrono::steady_clock::now();
         std::chrono::steady_clock::now() - begun < starts;)
      ;
    const auto period = std::chrono::milliseconds(declare_parameter("period_ms", 20));
    if (declare_parameter("wall", false))
      timer_ = create_wall_timer(period, [this] { tick(); });
    else
      timer_ = rclcpp::create_timer(this, get_clock(), period, [this] { tick(); });
  }

private:
  void tick() {
    String text;
    text.data = std::to_string(++ticks_) + " " + std::to_string(now().nanoseconds()) + " " +
                std::to_string(seen_);
    out_->publish(text);
  }

  int64_t seen_ = 0, ticks_ = 0;
  rclcpp::Publisher<String>::SharedPtr out_;
  rclcpp::Subscription<Imu>::SharedPtr in_;
  rclcpp::TimerBase::SharedPtr timer_;
};

}  // namespace bagpipe_nodes

RCLCPP_COMPONENTS_REGISTER_NODE(bagpipe_nodes::Ticking)
