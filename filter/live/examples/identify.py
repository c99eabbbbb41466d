"""Asks the node which part a hole is of: `identify(region) -> part, pose with covariance, or none of these`, as a planner would call
it. The robot stays the planner's: it gives the two motions of `Robot`.

    tactile-filter live --ros --model M --bank B
    python identify.py                 # here with a robot that asks a person to move the tool

`identify` knows no middleware: `RosNode` (rclpy, ROS 2 Humble or later) is one way to the node. For a ROS 2 action server, call it
in the goal's callback and publish `feedback` from `on_touch`; cancel by raising in `on_touch`.
"""

import json
from dataclasses import dataclass, field
from typing import Any, Callable, Optional, Protocol


class Robot(Protocol):
    """The motions that a touch takes."""

    def press(self, pose: Any) -> None:
        """Lifts, goes over a geometry_msgs/PoseStamped (`None`: over the region), presses, and returns when the tool is still."""

    def lift(self) -> None:
        """Lifts the tool off the board."""


class Node(Protocol):
    """What is asked of the node."""

    def call(self, service: str) -> tuple[bool, str]:
        """Calls a std_srvs/Trigger, `observe` or `reset`; whether it succeeded, and what it says."""

    def seen(self, region: Any) -> None:
        """Publishes `~/part_pose`."""

    def latest(self, topic: str) -> Any:
        """Waits for the message that belongs to the last `observe` on `decision`, `next_pose` or `pose`."""


@dataclass
class Identified:
    """What a hole is."""

    # Confident of it; without: the likeliest part when touches ran out.
    sure: bool
    # The part; none where none of the bank's parts was felt.
    part: Optional[str]
    # geometry_msgs/PoseWithCovarianceStamped of the part in the base frame; none without a part.
    pose: Any
    # Why it ended: confident, none-of-these, touch-limit, nothing-to-learn.
    stop: str
    # Each touch's ~/decision.
    touches: list = field(default_factory=list)


class Refused(Exception):
    """The node took no touch; what it believes is as before. Call again after what it names is mended."""


def identify(
    node: Node,
    robot: Robot,
    region: Any = None,
    on_touch: Callable[[dict], None] = lambda decision: None,
) -> Identified:
    """Touches a hole until the node stops. `region`: a geometry_msgs/PoseWithCovarianceStamped where a part may be known to be."""

    def called(service: str) -> None:
        succeeded, said = node.call(service)
        if not succeeded:
            robot.lift()
            raise Refused(f"{service}: {said}")

    called("reset")
    if region is not None:
        node.seen(region)
    touches, pose = [], None
    while True:
        robot.press(pose)
        called("observe")
        decision = json.loads(node.latest("decision").data)
        touches.append(decision)
        on_touch(decision)
        if decision["stop"]:
            break
        pose = node.latest("next_pose")
    robot.lift()
    if decision["stop"] == "none-of-these":
        return Identified(True, None, None, decision["stop"], touches)
    sure = decision["stop"] == "confident"
    return Identified(sure, decision["estimate"]["part"], node.latest("pose"), decision["stop"], touches)


class RosNode:
    """The node over rclpy."""

    def __init__(self, name: str = "/tactile_filter", patience_s: float = 15.0):
        import rclpy
        from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
        from rclpy.qos import DurabilityPolicy, QoSProfile
        from std_msgs.msg import String
        from std_srvs.srv import Trigger

        self.rclpy, self.trigger, self.patience_s = rclpy, Trigger, patience_s
        self.node = rclpy.create_node("identify")
        self.services = {of: self.node.create_client(Trigger, f"{name}/{of}") for of in ("observe", "reset")}
        self.to_seen = self.node.create_publisher(PoseWithCovarianceStamped, f"{name}/part_pose", 1)
        # Latched: who comes late gets the newest.
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.came = {}
        for topic, kind in {"decision": String, "next_pose": PoseStamped, "pose": PoseWithCovarianceStamped}.items():
            keep = lambda message, topic=topic: self.came.update({topic: message})
            self.node.create_subscription(kind, f"{name}/{topic}", keep, latched)

    def call(self, service):
        client = self.services[service]
        if not client.wait_for_service(self.patience_s):
            return False, "no such service; does the node run?"
        # What came before belongs to an earlier touch; one spin takes in one message.
        for _ in range(20):
            self.rclpy.spin_once(self.node, timeout_sec=0.0)
        self.came.clear()
        future = client.call_async(self.trigger.Request())
        self.rclpy.spin_until_future_complete(self.node, future, timeout_sec=self.patience_s)
        answer = future.result()
        return (False, "no answer") if answer is None else (answer.success, answer.message)

    def seen(self, region):
        self.to_seen.publish(region)

    def latest(self, topic):
        end = self.node.get_clock().now().nanoseconds + int(self.patience_s * 1e9)
        while topic not in self.came:
            self.rclpy.spin_once(self.node, timeout_sec=0.1)
            if self.node.get_clock().now().nanoseconds > end:
                raise TimeoutError(f"nothing on {topic}")
        return self.came[topic]


class ByHand:
    """A person moves the tool."""

    def press(self, pose):
        where = "over the hole" if pose is None else f"over {pose.pose.position} {pose.pose.orientation}"
        input(f"Bring the tool {where}, press, let it settle, then Enter: ")

    def lift(self):
        print("Lift the tool.")


def main():
    import rclpy

    rclpy.init()
    found = identify(RosNode(), ByHand(), on_touch=lambda decision: print(decision["estimate"]["part"]))
    print("none of these parts" if found.part is None else f"{found.part}{'' if found.sure else '?'}: {found.pose}")


if __name__ == "__main__":
    main()
