// SPDX-License-Identifier: Apache-2.0
#include "client/app/calibration_saver.h"

#include <gmock/gmock.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/sinks/null_sink.h>

#include <mutex>
#include <stdexcept>

#include "common/io/calibration.h"
#include "common/io/test_directory.h"

namespace cairn {
namespace {

struct FullLog : spdlog::sinks::base_sink<std::mutex> {
  void sink_it_(const spdlog::details::log_msg& /*message*/) override {
    throw std::runtime_error("the log is full, as it were");
  }
  void flush_() override {}
};

Logger log_to(spdlog::sink_ptr sink) {
  auto log = std::make_shared<spdlog::logger>("test", std::move(sink));
  log->set_error_handler([](const std::string& what) { throw std::runtime_error(what); });
  return log;
}

class CalibrationSaverTest : public testing::Test {
 protected:
  CameraUpdate told(bool is_known) const {
    CameraUpdate update;
    update.camera = make_camera(camera_).value();
    update.frozen = is_known;
    return update;
  }
  /// Tells it of a camera that is known well enough, and waits for the file.
  Status save(const std::filesystem::path& path, spdlog::sink_ptr sink) const {
    CalibrationSaver saver(path, log_to(std::move(sink)));
    saver.on_camera(told(true));
    return saver.finish([] { return false; });
  }

  const TestDirectory directory_;
  const CameraParameters camera_{
      CameraModel::kPinholeRadtan, 640, 480, {500, 500, 319.5, 239.5, 0.01, 0, 0, 0, 0}};
};

TEST_F(CalibrationSaverTest, WhatItWritesIsReadAgain) {
  const auto path = directory_.path() / "camera.yaml";
  const Status saved = save(path, std::make_shared<spdlog::sinks::null_sink_mt>());
  ASSERT_TRUE(saved) << saved.error().message;
  const auto read = read_calibration(path);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->values, camera_.values);
}

TEST_F(CalibrationSaverTest, WhatItsThreadThrowsIsTold) {
  const auto path = directory_.path() / "camera.yaml";
  const Status saved = save(path, std::make_shared<FullLog>());
  ASSERT_FALSE(saved);
  EXPECT_EQ(saved.error().code, ErrorCode::kIo);
  EXPECT_THAT(saved.error().message, testing::HasSubstr("camera.yaml: the log is full"));
}

TEST_F(CalibrationSaverTest, ACameraThatIsNotKnownIsNotWritten) {
  CalibrationSaver saver(directory_.path() / "camera.yaml", log_to(std::make_shared<FullLog>()));
  saver.on_camera(told(false));
  const Status saved = saver.finish([] { return false; });
  ASSERT_FALSE(saved);
  EXPECT_EQ(saved.error().code, ErrorCode::kDegenerate);
  EXPECT_FALSE(std::filesystem::exists(directory_.path() / "camera.yaml"));
}

}  // namespace
}  // namespace cairn
