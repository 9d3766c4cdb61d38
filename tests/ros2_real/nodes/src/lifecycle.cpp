// A node with a life cycle: configured it subscribes to in, and only active it answers.
#include <memory>
#include <string>

#include <rclcpp/rclcpp.hpp>
#include <rclcpp_lifecycle/lifecycle_node.hpp>
#include <sensor_msgs/msg/imu.hpp>
#include <std_msgs/msg/string.hpp>

using rclcpp_lifecycle::LifecycleNode;
using rclcpp_lifecycle::State;
using sensor_msgs::msg::Imu;
using std_msgs::msg::String;
using Return = rclcpp_lifecycle::node_interfaces::LifecycleNodeInterface::CallbackReturn;

class Living : public LifecycleNode {
public:
  Living() : LifecycleNode("living") {
    by_itself_ = declare_parameter("by_itself", true);
    leave_after_ = declare_parameter("leave_after", 0);
  }

  void begin() {
    if (!by_itself_) return;
    configure();
    activate();
  }

  Return on_configure(const State &) override {
    out_ = create_publisher<String>("out", rclcpp::QoS(1000));
    in_ = create_subscription<Imu>("in", rclcpp::QoS(10), [this](const Imu &message) {
      String answer;
      answer.data = std::to_string(rclcpp::Time(message.header.stamp).nanoseconds());
      if (out_->is_activated()) out_->publish(answer);
      if (++got_ == leave_after_) deactivate();
    });
    return Return::SUCCESS;
  }

private:
  bool by_itself_;
  int leave_after_, got_ = 0;  // messages; never after 0
  rclcpp_lifecycle::LifecyclePublisher<String>::SharedPtr out_;
  rclcpp::Subscription<Imu>::SharedPtr in_;
};

int main(int count, char **words) {
  rclcpp::init(count, words);
  auto node = std::make_shared<Living>();
  node->begin();
  rclcpp::spin(node->get_node_base_interface());
  rclcpp::shutdown();
  return 0;
}
