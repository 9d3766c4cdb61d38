// Publishes a text on in, and the next one when the answer to it has come on out: what a step takes
// where nobody proves anything. The file that the parameter names gets the number of rounds and the
// nanoseconds that they took together.
#include <chrono>
#include <fstream>
#include <string>

#include <rclcpp/rclcpp.hpp>
#include <rclcpp_components/register_node_macro.hpp>
#include <std_msgs/msg/string.hpp>

namespace bagpipe_nodes {

using namespace std::chrono_literals;
using std_msgs::msg::String;
using Clock = std::chrono::steady_clock;

class Pinging : public rclcpp::Node {
public:
  explicit Pinging(const rclcpp::NodeOptions &options) : Node("pinging", options) {
    report_ = declare_parameter("report", std::string("/dev/null"));
    rounds_ = declare_parameter("rounds", 1000);
    text_.data = std::string(declare_parameter("bytes", 1000), 'x');
    in_ = create_publisher<String>("in", rclcpp::QoS(10));
    out_ = create_subscription<String>("out", rclcpp::QoS(10), [this](const String &) { answered(); });
    // Each side may know of the other first.
    start_ = create_wall_timer(500ms, [this] {
      if (in_->get_subscription_count() == 0 || out_->get_publisher_count() == 0) return;
      if (known_++ == 0) return;
      start_->cancel();
      begun_ = Clock::now();
      in_->publish(text_);
    });
  }

private:
  void answered() {
    if (++count_ < rounds_) return in_->publish(text_);
    const std::chrono::nanoseconds took = Clock::now() - begun_;
    std::ofstream(report_) << count_ << " " << took.count();
    rclcpp::shutdown();
  }

  std::string report_;
  int64_t rounds_, count_ = 0, known_ = 0;
  String text_;
  Clock::time_point begun_;
  rclcpp::Publisher<String>::SharedPtr in_;
  rclcpp::Subscription<String>::SharedPtr out_;
  rclcpp::TimerBase::SharedPtr start_;
};

}  // namespace bagpipe_nodes

RCLCPP_COMPONENTS_REGISTER_NODE(bagpipe_nodes::Pinging)
