// Does nothing with each text of in but count it. At its end the file that the parameter names gets
// the count, and the nanoseconds from the first to the last, and from its start to the first.
#include <chrono>
#include <fstream>
#include <string>

#include <rclcpp/rclcpp.hpp>
#include <rclcpp_components/register_node_macro.hpp>
#include <std_msgs/msg/string.hpp>

namespace bagpipe_nodes {

using std_msgs::msg::String;
using Clock = std::chrono::steady_clock;

class Counting : public rclcpp::Node {
public:
  explicit Counting(const rclcpp::NodeOptions &options) : Node("counting", options) {
    report_ = declare_parameter("report", std::string("/dev/null"));
    rclcpp::QoS qos(declare_parameter("depth", 10));
    in_ = create_subscription<String>("in", qos, [this](const String &) {
      last_ = Clock::now();
      if (count_++ == 0) first_ = last_;
    });
    ready_ = Clock::now();
  }

  ~Counting() override {
    const auto between = [](auto from, auto to) { return std::chrono::nanoseconds(to - from).count(); };
    std::ofstream(report_) << count_ << " " << between(first_, last_) << " " << between(ready_, first_);
  }

private:
  std::string report_;
  uint64_t count_ = 0;
  Clock::time_point ready_, first_, last_;
  rclcpp::Subscription<String>::SharedPtr in_;
};

}  // namespace bagpipe_nodes

RCLCPP_COMPONENTS_REGISTER_NODE(bagpipe_nodes::Counting)
