// SPDX-License-Identifier: Apache-2.0
// cairn-sim: lists simulated worlds, writes recordings of them with exact truth, in TUM layout, and judges
// what a tracker made of them.

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <array>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <regex>
#include <sstream>
#include <string>
#include <system_error>
#include <vector>

#include "common/base/help_formats.h"
#include "common/base/log.h"
#include "common/base/stream_writer.h"
#include "common/base/unknown_word.h"
#include "common/base/version.h"
#include "tests/world/annotation.h"
#include "tests/world/judge.h"
#include "tests/world/labels.h"
#include "tests/world/simulator.h"

namespace cairn {
namespace {

constexpr int kCheckFailed = 1;
constexpr int kInterrupted = 130;

std::atomic<bool> interrupted = false;  // the one thing that a signal handler may touch
/// The second one ends the process at once.
void on_interrupt(int signal) {
  interrupted = true;
  std::signal(signal, SIG_DFL);
}

struct RenderRequest {
  std::string scenario;
  std::filesystem::path directory;
  SimulatorOptions options;
  bool images = true;
};

std::string frame_name(Timestamp time) {
  std::array<char, 40> name;
  std::snprintf(name.data(), name.size(), "rgb/%012.6f.png", time.seconds());
  return name.data();
}

Result<std::ofstream> open_file(const std::filesystem::path& path) {
  std::ofstream file(path);
  if (!file) return fail(ErrorCode::kIo, path.string() + ": cannot be written");
  file << std::fixed << std::setprecision(9);
  return file;
}

Status write_camera(const std::filesystem::path& directory, const CameraParameters& camera) {
  auto file = open_file(directory / "camera.txt");
  if (!file) return tl::unexpected(file.error());
  *file << "# width height fx fy cx cy k1 k2 p1 p2 (OpenCV)  pixel centres at integer coordinates\n"
        << camera.width << ' ' << camera.height << std::defaultfloat;
  for (size_t i = 0; i < 8; ++i) *file << ' ' << camera.values[i];
  *file << '\n';
  if (!file->flush()) return fail(ErrorCode::kIo, "camera.txt: write failed");
  return {};
}

Status write_image(const std::filesystem::path& path, const GrayImage& image) {
  const cv::Mat pixels(image.height(), image.width(), CV_8UC1, const_cast<uint8_t*>(image.row(0)),
                       static_cast<size_t>(image.stride()));
  try {
    if (cv::imwrite(path.string(), pixels, {cv::IMWRITE_PNG_COMPRESSION, 1})) return {};
    return fail(ErrorCode::kIo, path.string() + ": cannot be written");
  } catch (const cv::Exception& error) {
    return fail(ErrorCode::kIo, path.string() + ": " + error.what());
  }
}

void write_pose(std::ostream& file, Timestamp time, const SE3& map_from_camera) {
  const Eigen::Vector3d& t = map_from_camera.translation();
  const Eigen::Quaterniond& q = map_from_camera.rotation();
  file << time.seconds() << ' ' << t.x() << ' ' << t.y() << ' ' << t.z() << ' ' << q.x() << ' ' << q.y()
       << ' ' << q.z() << ' ' << q.w() << '\n';
}

/// Images of an earlier recording in the folder, which no list would name.
Status remove_frames(const std::filesystem::path& folder) {
  const std::regex name("[0-9]{5}\\.[0-9]{6}\\.png");
  std::error_code error;
  std::vector<std::filesystem::path> old;
  auto entry = std::filesystem::directory_iterator(folder, error);
  for (; !error && entry != std::filesystem::directory_iterator(); entry.increment(error)) {
    if (std::regex_match(entry->path().filename().string(), name)) old.push_back(entry->path());
  }
  for (const auto& path : old) {
    if (!error) std::filesystem::remove(path, error);
  }
  if (error) return fail(ErrorCode::kIo, folder.string() + ": " + error.message());
  return {};
}

Status render(const RenderRequest& request) {
  auto simulator = Simulator::make(request.scenario, request.options);
  if (!simulator) return tl::unexpected(simulator.error());
  std::error_code error;
  std::filesystem::create_directories(request.directory / "rgb", error);
  if (error) return fail(ErrorCode::kIo, (request.directory / "rgb").string() + ": " + error.message());
  auto list = open_file(request.directory / "rgb.txt");
  if (!list) return tl::unexpected(list.error());
  auto truth = open_file(request.directory / "groundtruth.txt");
  if (!truth) return tl::unexpected(truth.error());
  auto depths = open_file(request.directory / "depths.txt");
  if (!depths) return tl::unexpected(depths.error());
  if (auto status = remove_frames(request.directory / "rgb"); !status) return status;
  if (auto status = write_camera(request.directory, simulator->camera().parameters()); !status) return status;
  if (auto status = write_annotation(request.directory, annotate(*simulator)); !status) return status;
  if (auto status = write_label_targets(request.directory, choose_label_targets(&*simulator)); !status)
    return status;

  *list << "# timestamp filename\n" << std::setprecision(6);
  *depths << "# timestamp depth: median of what the frame shows [m], 0 in the dark\n";
  *truth << "# timestamp tx ty tz qx qy qz qw  camera to world, exact\n";
  const int count = simulator->frame_count();
  const bool is_terminal = isatty(STDERR_FILENO) != 0;
  const char* line_start = is_terminal ? "\r" : "";
  const char* line_end = is_terminal ? "" : "\n";
  // Whoever hangs while reading this does not hold up the recording.
  const auto progress = StreamWriter::of_descriptor(STDERR_FILENO, "standard error");
  int written = 0;
  for (; written < count && !interrupted; ++written) {
    const Timestamp time = simulator->time(written);
    write_pose(*truth, time, simulator->map_from_camera(time.seconds()));
    *depths << time.seconds() << ' ' << simulator->view(written).depth << '\n';
    if (!request.images) continue;
    const std::string name = frame_name(time);
    if (auto status = write_image(request.directory / name, simulator->frame(written).image); !status) {
      return status;
    }
    *list << time.seconds() << ' ' << name << '\n';
    // Whoever is killed leaves a recording that is shorter.
    list->flush();
    truth->flush();
    if (written % 30 != 29 && written + 1 != count) continue;
    std::ostringstream line;
    line << line_start << "frame " << written + 1 << " of " << count << line_end;
    (void)progress->write(line.str());
  }
  if (is_terminal) (void)progress->write("\n");
  if (!list->flush() || !truth->flush() || !depths->flush()) {
    return fail(ErrorCode::kIo, request.directory.string() + ": write failed (disk full?)");
  }
  if (written < count) {
    std::ostringstream line;
    line << "cairn-sim: interrupted: " << request.directory.string() << " has " << written << " of " << count
         << " frames\n";
    (void)progress->write(line.str());
    return {};
  }
  std::cout << request.directory.string() << '\n';
  return {};
}

/// CLI options --seed, --frames ... for every option of the simulator.
void add_simulator_options(CLI::App* command, std::map<std::string, std::string>* values) {
  for (const auto& [key, text] : SimulatorOptions::help()) {
    command->add_option("--" + std::string(key), (*values)[std::string(key)], std::string(text));
  }
}

struct JudgeRequest {
  std::vector<std::string> pairs;  ///< recording, trajectory, recording, ...
  bool json = false;
  bool check = false;
  MapExtent extent = MapExtent::kOnePlace;
  std::filesystem::path labels;  ///< empty: they are not judged
};

CLI::App* declare_judge(CLI::App* app, JudgeRequest* request) {
  CLI::App* command = app->add_subcommand(
      "judge", "which places a tracker mapped, which it found again and how fast, and where it was wrong");
  command
      ->add_option("files", request->pairs,
                   "recording and trajectory, in pairs: the walks of one experiment in order")
      ->required()
      ->type_name("RECORDING TRAJECTORY");
  command->add_flag("--json", request->json, "one JSON document on stdout");
  command->add_flag_callback(
      "--many-places", [request] { request->extent = MapExtent::kManyPlaces; },
      "a map is the map of every place that was mapped in it, not only of the first; tells its drift");
  command
      ->add_option(
          "--labels", request->labels,
          "what `cairnctl --json labels` says after the walks: whether each place that is mapped has "
          "the label that labels.txt asks for, and where it appears at the visits")
      ->type_name("FILE");
  command->add_flag(
      "--check", request->check,
      "exit code 1 unless every place is mapped and found at every visit, without a wrong lock");
  return command;
}

Result<Verdict> judge_files(const JudgeRequest& request) {
  const std::vector<std::string>& pairs = request.pairs;
  if (pairs.size() % 2 != 0)
    return fail(ErrorCode::kUsage, "judge: pairs of recording and trajectory, please");
  std::vector<WalkRecord> walks;
  for (size_t i = 0; i < pairs.size(); i += 2) {
    auto walk = read_walk(pairs[i], pairs[i + 1]);
    if (!walk) return tl::unexpected(walk.error());
    walks.push_back(std::move(*walk));
  }
  if (request.labels.empty()) return judge(walks, request.extent);
  const auto labels = read_placed_labels(request.labels);
  if (!labels) return tl::unexpected(labels.error());
  return judge(walks, request.extent, *labels);
}

int report(const Error& error) {
  say_error("cairn-sim", error.message);
  return exit_code(error.code);
}

/// 0, or the exit code when what was printed could not be written.
int finish_output() {
  if (std::cout.flush()) return 0;
  return report({ErrorCode::kIo, "standard output: cannot be written (disk full?)"});
}

int run(int argc, char** argv) {
  CLI::App app("Simulated worlds with exact truth.", "cairn-sim");
  app.require_subcommand(1);
  app.footer(
      "Exit codes: 0 ok; 1 failed, or --check and the maps are worse than asked for; 2 usage, 3 configuration "
      "or a file, 6 damaged data, 130 interrupted\n\n"
      "Examples:\n"
      "  cairn-sim list\n"
      "  cairn-sim render desk --out /tmp/desk\n"
      "  cairn-sim render desk --out /tmp/hard --seed 7 --frames 600 --noise 6 --blur 0.8 --speed 2\n"
      "  cairn-track --source tum:/tmp/desk --trajectory /tmp/est.txt && cairn-eval ate "
      "/tmp/desk/groundtruth.txt /tmp/est.txt\n"
      "  cairn-sim judge /tmp/map map.txt /tmp/visit visit.txt");
  app.formatter(std::make_shared<OwnFooter>());
  app.set_version_flag("--version", "cairn-sim " + std::string(version()));
  const CLI::App* list = app.add_subcommand("list", "names the scenarios, one a line, with a description");
  CLI::App* render_command =
      app.add_subcommand("render",
                         "writes rgb.txt, rgb/*.png, groundtruth.txt and camera.txt (TUM layout), "
                         "places.txt (what each frame shows), phases.txt (what the wearer does), labels.txt "
                         "(what is labelled on the way, for `cairn-track --labels`) and label_truth.txt");
  RenderRequest request;
  std::map<std::string, std::string> values;
  render_command->add_option("scenario", request.scenario, "a name from `cairn-sim list`")->required();
  render_command->add_option("--out", request.directory, "directory to write to; made if missing")
      ->required();
  bool no_images = false;
  render_command->add_flag(
      "--no-images", no_images,
      "truth and annotation only: a tracker reads `sim:` itself; images of an earlier recording there are "
      "removed");
  add_simulator_options(render_command, &values);
  JudgeRequest judge_request;
  const CLI::App* judge_command = declare_judge(&app, &judge_request);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return end_of_parse(app, error);
  }
  if (list->parsed()) {
    for (const ScenarioInfo& info : scenario_list())
      std::cout << info.name << '\t' << info.description << '\n';
    return finish_output();
  }
  if (judge_command->parsed()) {
    const auto verdict = judge_files(judge_request);
    if (!verdict) return report(verdict.error());
    std::cout << (judge_request.json ? verdict_json(*verdict) : verdict_text(*verdict));
    if (const int code = finish_output(); code != 0) return code;
    return judge_request.check && !verdict->passes() ? kCheckFailed : 0;
  }
  for (const auto& [key, value] : values) {
    if (render_command->count("--" + key) == 0) continue;
    if (auto status = request.options.set_option(key, value); !status) return report(status.error());
  }
  request.images = !no_images;
  std::signal(SIGINT, on_interrupt);
  std::signal(SIGTERM, on_interrupt);
  if (std::signal(SIGHUP, on_interrupt) == SIG_IGN) std::signal(SIGHUP, SIG_IGN);  // nohup
  if (auto status = render(request); !status) return report(status.error());
  return interrupted ? kInterrupted : 0;
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  try {
    return cairn::run(argc, argv);
  } catch (const std::exception& error) {
    cairn::say_error("cairn-sim", error.what());
    return cairn::exit_code(cairn::ErrorCode::kInternal);
  }
}
