// SPDX-License-Identifier: Apache-2.0
// For dbc_test.py: the codecs of this folder in lines of text.
//   dbc_exchange encode SEED COUNT   COUNT random messages of each kind, as below
//   dbc_exchange decode              reads lines "ID HEX", writes for each "ID HEX NAME SIGNAL=VALUE ..." as
//   rig.dbc names them
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <numbers>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "hw/can/odrive.h"
#include "hw/can/xsens.h"

namespace cairn {
namespace {

constexpr std::array<odrive::Node, 2> kDrives = {{{16}, {17}}};
constexpr double kDegrees = 180 / std::numbers::pi;

struct Signal {
  const char* name;
  double value;
};

/// A message as rig.dbc has it.
struct Described {
  std::string name;
  std::vector<Signal> signals;
};

struct DescribeOdrive {
  Described operator()(const odrive::Heartbeat& m) const {
    return {"Heartbeat",
            {{"Axis_Error", static_cast<double>(m.axis_error)},
             {"Axis_State", static_cast<double>(m.state)},
             {"Procedure_Result", static_cast<double>(m.procedure_result)},
             {"Trajectory_Done", m.trajectory_done ? 1.0 : 0.0}}};
  }
  Described operator()(const odrive::Errors& m) const {
    return {"Get_Error",
            {{"Active_Errors", static_cast<double>(m.active_errors)},
             {"Disarm_Reason", static_cast<double>(m.disarm_reason)}}};
  }
  Described operator()(const odrive::EncoderEstimates& m) const {
    return {"Get_Encoder_Estimates", {{"Pos_Estimate", m.position}, {"Vel_Estimate", m.velocity}}};
  }
  Described operator()(const odrive::Estop&) const { return {"Estop", {}}; }
  Described operator()(const odrive::SetAxisState& m) const {
    return {"Set_Axis_State", {{"Axis_Requested_State", static_cast<double>(m.state)}}};
  }
  Described operator()(const odrive::SetControllerMode& m) const {
    return {"Set_Controller_Mode",
            {{"Control_Mode", static_cast<double>(m.control)}, {"Input_Mode", static_cast<double>(m.input)}}};
  }
  Described operator()(const odrive::SetInputPosition& m) const {
    return {
        "Set_Input_Pos",
        {{"Input_Pos", m.position}, {"Vel_FF", m.velocity_feedforward}, {"Torque_FF", m.torque_feedforward}}};
  }
  Described operator()(const odrive::SetLimits& m) const {
    return {"Set_Limits", {{"Velocity_Limit", m.velocity}, {"Current_Limit", m.current}}};
  }
  Described operator()(const odrive::ClearErrors& m) const {
    return {"Clear_Errors", {{"Identify", m.identify ? 1.0 : 0.0}}};
  }
  Described operator()(odrive::Request) const { return {"Request", {}}; }
};

struct DescribeXsens {
  Described operator()(const xsens::SampleTime& m) const {
    return {"SampleTime", {{"Ticks", static_cast<double>(m.ticks)}}};
  }
  Described operator()(const xsens::GroupCounter& m) const {
    return {"GroupCounter", {{"Count", static_cast<double>(m.count)}}};
  }
  Described operator()(const xsens::StatusWord& m) const {
    return {"StatusWord", {{"Bits", static_cast<double>(m.bits)}}};
  }
  Described operator()(const xsens::Quaternion& m) const {
    return {"Quaternion", {{"q_w", m.w}, {"q_x", m.x}, {"q_y", m.y}, {"q_z", m.z}}};
  }
  Described operator()(const xsens::Euler& m) const {
    return {"Euler", {{"Roll", m.roll * kDegrees}, {"Pitch", m.pitch * kDegrees}, {"Yaw", m.yaw * kDegrees}}};
  }
  Described operator()(const xsens::RateOfTurn& m) const {
    return {"RateOfTurn", {{"Gyr_X", m.rate[0]}, {"Gyr_Y", m.rate[1]}, {"Gyr_Z", m.rate[2]}}};
  }
  Described operator()(const xsens::Acceleration& m) const {
    return {"Acceleration",
            {{"Acc_X", m.acceleration[0]}, {"Acc_Y", m.acceleration[1]}, {"Acc_Z", m.acceleration[2]}}};
  }
};

std::string hex(const CanFrame& frame) {
  const std::string text = to_string(frame);
  return text.substr(text.find('#') + 1);
}

void print(const CanFrame& frame, const Described& described) {
  std::printf("%u %s %s", frame.id.value, frame.length == 0 ? "-" : hex(frame).c_str(),
              described.name.c_str());
  for (const Signal& signal : described.signals) std::printf(" %s=%.17g", signal.name, signal.value);
  std::printf("\n");
}

Described describe(const odrive::Addressed& from) {
  Described described = std::visit(DescribeOdrive(), from.message);
  described.name = (from.node == kDrives[0] ? "Pan_" : "Tilt_") + described.name;
  return described;
}

Described describe(const xsens::Message& message) {
  Described described = std::visit(DescribeXsens(), message);
  described.name = "Imu_" + described.name;
  return described;
}

/// Random messages, over the whole of their fields.
class Source {
 public:
  explicit Source(uint32_t seed) : random_(seed) {}

  std::vector<odrive::Message> odrive() {
    return {odrive::Heartbeat{word(), static_cast<odrive::AxisState>(word() % 14),
                              static_cast<uint8_t>(word()), word() % 2 == 1},
            odrive::Errors{word(), word()},
            odrive::EncoderEstimates{number(1e6F), number(1e3F)},
            odrive::Estop{},
            odrive::SetAxisState{static_cast<odrive::AxisState>(word())},
            odrive::SetControllerMode{static_cast<odrive::ControlMode>(word()),
                                      static_cast<odrive::InputMode>(word())},
            odrive::SetInputPosition{number(100), number(32.767F), number(32.767F)},
            odrive::SetLimits{number(1e3F), number(60)},
            odrive::ClearErrors{word() % 2 == 1}};
  }
  std::vector<xsens::Message> xsens() {
    return {xsens::SampleTime{word()},
            xsens::GroupCounter{static_cast<uint16_t>(word())},
            xsens::StatusWord{word()},
            xsens::Quaternion{number(1), number(1), number(1), number(1)},
            xsens::Euler{number(3.14F), number(1.57F), number(3.14F)},
            xsens::RateOfTurn{{number(63.9F), number(63.9F), number(63.9F)}},
            xsens::Acceleration{{number(127.9F), number(127.9F), number(127.9F)}}};
  }

 private:
  uint32_t word() { return static_cast<uint32_t>(random_()); }
  float number(float limit) { return std::uniform_real_distribution<float>(-limit, limit)(random_); }

  std::mt19937 random_;
};

int encode(uint32_t seed, int count) {
  Source source(seed);
  for (int i = 0; i < count; ++i) {
    for (const odrive::Node node : kDrives) {
      for (const odrive::Message& message : source.odrive())
        print(odrive::encode(node, message).value(), describe(odrive::Addressed{node, message}));
    }
    for (const xsens::Message& message : source.xsens())
      print(xsens::encode(message).value(), describe(message));
  }
  return 0;
}

CanFrame parse(const std::string& line) {
  std::istringstream words(line);
  CanFrame frame;
  std::string bytes;
  words >> frame.id.value >> bytes;
  for (size_t i = 0; i + 1 < bytes.size() && frame.length < kMaxClassicPayload; i += 2)
    frame.data.at(frame.length++) = static_cast<uint8_t>(std::stoul(bytes.substr(i, 2), nullptr, 16));
  return frame;
}

int decode() {
  for (std::string line; std::getline(std::cin, line);) {
    const CanFrame frame = parse(line);
    if (const auto from_drive = odrive::decode(frame, kDrives)) {
      print(frame, describe(*from_drive));
    } else if (const auto from_imu = xsens::decode(frame)) {
      print(frame, describe(*from_imu));
    } else {
      std::fprintf(stderr, "%s\n%s\n", describe(from_drive.error(), "ODrive").c_str(),
                   describe(from_imu.error(), "Xsens").c_str());
      return 1;
    }
  }
  return 0;
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  if (arguments.size() == 3 && arguments[0] == "encode") {
    return cairn::encode(static_cast<uint32_t>(std::stoul(arguments[1])), std::stoi(arguments[2]));
  }
  if (arguments.size() == 1 && arguments[0] == "decode") return cairn::decode();
  std::fputs("usage: dbc_exchange encode SEED COUNT | decode\n", stderr);
  return 2;
}
