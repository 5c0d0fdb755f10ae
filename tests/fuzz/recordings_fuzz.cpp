// SPDX-License-Identifier: Apache-2.0
//
// The lists and tables of recordings: frames (TUM, EuRoC, a list of times), trajectories, IMU samples, how
// sensors are mounted. The first byte says which.
#include <array>
#include <cmath>

#include "client/capture/frame_source.h"
#include "client/capture/imu_file.h"
#include "client/capture/stamp_list.h"
#include "common/base/utf8.h"
#include "common/io/sensor_yaml.h"
#include "common/io/trajectory.h"
#include "tests/fuzz/fuzz_target.h"

namespace cairn::fuzz {
namespace {

const OwnFolder& folder() {
  static const OwnFolder made;
  return made;
}

/// All frames that a list names; their images are not there.
void read_frames(const std::string& uri) {
  const auto source = open_source(uri);
  if (!source) return demand(!source.error().message.empty(), "a refusal has a reason");
  const auto span = (*source)->time_span();
  demand(!span || span->first <= span->second, "a recording ends after its beginning");
  static_cast<void>((*source)->describe());
  for (int i = 0; i < 3; ++i) {
    const auto frame = (*source)->next();
    if (frame && !*frame) break;
  }
}

void read_tum(Bytes bytes) {
  folder().write("tum/rgb.txt", bytes);
  read_frames("tum:" + (folder().path() / "tum").string());
}

void read_euroc(Bytes bytes) {
  folder().write("euroc/mav0/cam0/data.csv", bytes);
  read_frames("euroc:" + (folder().path() / "euroc").string());
}

void read_list_of_times(Bytes bytes) {
  const MemoryFile file(bytes);
  for (const TimeUnit unit : {TimeUnit::kSeconds, TimeUnit::kMilliseconds, TimeUnit::kNanoseconds}) {
    if (const auto times = read_times(file.path(), unit))
      static_cast<void>(vet_stamps(file.path(), *times, {unit, false}));
  }
}

void read_poses(Bytes bytes) {
  const MemoryFile file(bytes);
  const auto trajectory = read_trajectory(file.path());
  if (!trajectory) return demand(!trajectory.error().message.empty(), "a refusal has a reason");
  demand(trajectory->pose_count() > 0, "a trajectory has a pose");
  for (const TrajectorySegment& segment : trajectory->segments) {
    demand(!fault_of_text(segment.map_name), "the name of a map can be shown");
    for (const StampedPose& pose : segment.poses)
      demand(pose.map_from_camera.is_finite(), "a pose is finite");
  }
}

void read_samples(Bytes bytes) {
  const MemoryFile file(bytes);
  const auto samples = read_imu_file(file.path());
  if (!samples) return;
  for (size_t i = 0; i < samples->size(); ++i) {
    demand((*samples)[i].rate.allFinite() && (*samples)[i].acceleration.allFinite(), "a sample is finite");
    demand(i == 0 || (*samples)[i - 1].time < (*samples)[i].time, "samples are in the order of time");
  }
}

void read_mount(Bytes bytes) {
  const MemoryFile file(bytes);
  if (const auto mount = read_sensor_mount(file.path()); mount && *mount)
    demand((*mount)->body_from_sensor.is_finite(), "a mount is finite");
  if (const auto imu = read_kalibr_imu(file.path()); imu && *imu)
    demand((*imu)->camera_from_imu.is_finite() && std::isfinite((*imu)->time_shift), "a mount is finite");
}

struct Decoder {
  void (*decode)(Bytes);
  std::vector<const char*> files;
};
const std::array kDecoders{
    Decoder{read_tum,
            {"# color images\n1305031102.175304 rgb/1305031102.175304.png\n1305031102.211214 rgb/b.png\n"
             "1305031102.243211 rgb/c d.png\n",
             "timestamp\tfilename\n0.0 ._a.png\n0.5 C:\\pictures\\a.png\n1e0 b.png\n"}},
    Decoder{read_euroc,
            {"#timestamp [ns],filename\n1403636579763555584,1403636579763555584.png\n"
             "1403636579813555456,1403636579813555456.png\n"}},
    Decoder{read_list_of_times, {"0.0\n0.033333\n0.066667\n", "1403636579763555584\n1403636579813555456\n"}},
    Decoder{read_poses,
            {"# t tx ty tz qx qy qz qw\n# map 00112233445566778899aabbccddeeff desk\n1.5 1 2 3 0 0 0 1\n"
             "2.5 1 2 3 0.5 0.5 0.5 0.5\n3.5 nan nan nan nan nan nan nan\n4.5 0 0 0 0 0 0 0\n",
             "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], "
             "q_RS_z []\n1403636579763555584,4.6,-1.7,0.6,0.5,0.5,0.5,0.5,0.1,0.2\n",
             "1403636579763555584.000000 1 2 3 0 0 0 1\n"}},
    Decoder{read_samples,
            {"#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],"
             "a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n1403636579758555392,-0.09,0.14,0.07,8.1,-0.3,-5.0\n"
             "1403636579763555584,-0.1,0.13,0.07,8.2,-0.3,-5.0\n1403636579768555520,-0.1,0.1,0.1,8,0,-5\n",
             "time ax ay az gx gy gz\n0.00 0 0 9.8 0 0 0.1\n0.01 0 0.1 9.8 0 0 0.1\n0.02 0 0 9.7 0 0 0.1\n"}},
    Decoder{
        read_mount,
        {"sensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: [0.0, -1.0, 0.0, -0.02, 1.0, 0.0, 0.0, "
         "-0.06, 0.0, 0.0, 1.0, 0.009, 0.0, 0.0, 0.0, 1.0]\n",
         "cam0:\n  T_cam_imu:\n  - [1.0, 0.0, 0.0, 0.1]\n  - [0.0, 1.0, 0.0, 0.0]\n  - [0.0, 0.0, 1.0, "
         "0.0]\n  - [0.0, 0.0, 0.0, 1.0]\n  timeshift_cam_imu: 0.004\n"}}};

}  // namespace

void decode(Bytes bytes) {
  if (bytes.empty()) return;
  kDecoders.at(bytes[0] % kDecoders.size()).decode(bytes.subspan(1));
}

std::vector<Input> seeds() {
  std::vector<Input> all;
  for (size_t i = 0; i < kDecoders.size(); ++i) {
    for (const char* file : kDecoders.at(i).files) all.push_back(input_of(i, file));
  }
  return all;
}

}  // namespace cairn::fuzz
