// SPDX-License-Identifier: Apache-2.0
// cairn-eval: trajectories against truth, what the statistics of runs say, the relocalizer over recordings.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>

#include "client/app/eval/metrics.h"
#include "client/app/eval/plot.h"
#include "client/app/eval/report.h"
#include "client/app/eval/run_stats.h"
#include "client/app/eval/truth.h"
#include "common/base/log.h"
#include "common/base/program_folder.h"
#include "common/base/suggestion.h"
#include "common/base/version.h"
#include "common/io/text.h"

namespace cairn {
namespace {

constexpr int kUsageExit = 2;

constexpr const char* kFooter = R"(Examples:
  cairn-eval ate groundtruth.txt trajectory.txt --plot trajectory.png
  cairn-eval stats run1.json run2.json --json
  cairn-eval reloc /data/recordings --ours
Exit codes: 0 ok, 1 no time matches or nothing to align, 2 usage, 3 a file that
cannot be read or written, 6 file damaged; of reloc: its own help.)";
constexpr const char* kTrajectoryFooter = R"(Examples:
  cairn-eval ate groundtruth.txt trajectory.txt
  cairn-eval rpe groundtruth.txt trajectory.txt --align se3 --delta 1 --delta-unit m --json
The same with evo: evo_ape tum TRUTH ESTIMATE -as --t_max_diff 0.02 (se3: -a)
                   evo_rpe tum TRUTH ESTIMATE -as --all_pairs --delta 1 --delta_unit m
Each map of the estimate is aligned by itself; the rows `# map ID NAME` tell them apart.)";
constexpr const char* kStatsFooter = R"(Examples:
  cairn-eval stats stats.json
  cairn-eval stats run*.json --json)";

struct TrajectoryArguments {
  std::string truth;
  std::string estimate;
  Alignment alignment = Alignment::kSim3;
  double max_difference = 0.02;
  RelativeOptions relative;
  bool json = false;
  std::string plot;
};

struct StatsArguments {
  std::vector<std::string> files;
  bool json = false;
};

/// CLI11's own words for it name the greatest double in full.
std::string check_not_negative(const std::string& text) {
  const auto number = parse_number(text);
  return number && *number >= 0 ? "" : "'" + text + "' is not a number from 0 on";
}

std::string check_positive(const std::string& text) {
  const auto number = parse_number(text);
  return number && *number > 0 ? "" : "'" + text + "' is not a number greater than 0";
}

void add_trajectory_options(CLI::App& command, TrajectoryArguments& arguments) {
  command
      .add_option(
          "TRUTH", arguments.truth,
          "TUM rows `t tx ty tz qx qy qz qw`, camera to world, or the data.csv of EuRoC's and TUM-VI's "
          "ground truth")
      ->required();
  command.add_option("ESTIMATE", arguments.estimate, "TUM rows, camera in map")->required();
  command
      .add_option_function<std::string>(
          "--align",
          [&](const std::string& name) {
            arguments.alignment = name == "se3" ? Alignment::kSe3 : Alignment::kSim3;
          },
          "sim3 (default): with scale; se3: the estimate is metric")
      ->check(CLI::IsMember({"sim3", "se3"}).description(""))
      ->type_name("sim3|se3");
  command.add_option("--t-max-diff", arguments.max_difference, "farthest apart that two times match [s]")
      ->check(check_not_negative)
      ->type_name("SECONDS")
      ->capture_default_str();
  command.add_flag("--json", arguments.json, "one JSON document on stdout");
  command.add_option("--plot", arguments.plot, "image of both paths and of the error over time")
      ->type_name("FILE.png");
  command.footer(kTrajectoryFooter);
}

PlotContent plot_content(const TrajectoryArguments& arguments, const Trajectory& truth,
                         const Comparison& comparison) {
  PlotContent content;
  content.title = std::filesystem::path(arguments.estimate).filename().string() + " against " +
                  std::filesystem::path(arguments.truth).filename().string();
  for (const auto& segment : truth.segments) {
    content.truth.insert(content.truth.end(), segment.poses.begin(), segment.poses.end());
  }
  for (const auto& map : comparison.maps) {
    if (!map.is_aligned) continue;
    auto& path = content.estimates.emplace_back();
    for (const auto& pose : map.poses) {
      path.push_back(
          {pose.time, SE3(pose.map_from_camera.rotation(),
                          Eigen::Vector3d(map.truth_from_map * pose.map_from_camera.translation()))});
    }
  }
  return content;
}

std::vector<std::string> notes_on(const TrajectoryArguments& arguments, const ReadTrajectory& truth,
                                  const ReadTrajectory& estimate, const Comparison& comparison) {
  auto notes = truth.notes;
  notes.insert(notes.end(), estimate.notes.begin(), estimate.notes.end());
  if (const auto doubt = doubt_quaternions(comparison)) {
    notes.push_back(words_of(*doubt, doubt->in_truth ? arguments.truth : arguments.estimate));
  }
  return notes;
}

/// Shared part of ate and rpe: `evaluate` makes the report and fills in the error of the plot.
template <typename Evaluate>
Status run_trajectories(const TrajectoryArguments& arguments, Evaluate evaluate) {
  const auto truth = read_truth(arguments.truth);
  if (!truth) return tl::unexpected(truth.error());
  const auto estimate = read_estimate(arguments.estimate);
  if (!estimate) return tl::unexpected(estimate.error());
  auto comparison =
      compare(truth->trajectory, estimate->trajectory, arguments.max_difference, arguments.alignment);
  if (!comparison) return tl::unexpected(comparison.error());
  comparison->notes = notes_on(arguments, *truth, *estimate, *comparison);
  for (const auto& note : comparison->notes) say_error("cairn-eval", "note: " + note);
  auto plot = plot_content(arguments, truth->trajectory, *comparison);
  const Result<std::string> report = evaluate(*comparison, plot);
  if (!report) return tl::unexpected(report.error());
  std::fputs(report->c_str(), stdout);
  if (arguments.plot.empty()) return {};
  return write_plot(arguments.plot, plot);
}

Status run_ate(const TrajectoryArguments& arguments) {
  return run_trajectories(arguments,
                          [&](const Comparison& comparison, PlotContent& plot) -> Result<std::string> {
                            const auto error = absolute_error(comparison);
                            plot.error_name = "absolute error";
                            plot.errors = error.errors;
                            plot.rmse = error.translation.rmse;
                            return arguments.json ? ate_json(comparison, error, arguments.alignment)
                                                  : ate_text(comparison, error, arguments.alignment);
                          });
}

Status run_rpe(const TrajectoryArguments& arguments) {
  return run_trajectories(
      arguments, [&](const Comparison& comparison, PlotContent& plot) -> Result<std::string> {
        const auto error = relative_error(comparison, arguments.relative.delta, arguments.relative.unit);
        if (!error) return tl::unexpected(error.error());
        plot.error_name = "relative error";
        plot.errors = error->errors;
        plot.rmse = error->translation.rmse;
        return arguments.json ? rpe_json(comparison, *error, arguments.alignment, arguments.relative)
                              : rpe_text(comparison, *error, arguments.alignment, arguments.relative);
      });
}

Status run_stats(const StatsArguments& arguments) {
  std::vector<NamedRun> runs;
  for (const auto& file : arguments.files) {
    const auto content = read_text_file(file);
    if (!content) return tl::unexpected(content.error());
    const auto summary = summarize_run(*content);
    if (!summary) return fail(summary.error().code, file + ": " + summary.error().message);
    runs.push_back({file, *summary});
  }
  std::fputs((arguments.json ? stats_json(runs) : stats_text(runs)).c_str(), stdout);
  return {};
}

/// The relocalizer is the server's, which this program does not link: the one beside it that does takes this
/// process over, with all words after `reloc`. Returns only what kept it from that.
Status run_reloc(char** words) {
  const auto folder = program_folder();
  if (folder.empty()) return fail(ErrorCode::kIo, "where this program lies cannot be told: is /proc there?");
  const auto program = folder / "cairn-places-run";
  if (access(program.c_str(), X_OK) != 0) {
    return fail(ErrorCode::kConfiguration,
                program.string() + ": " + std::strerror(errno) +
                    "; it needs the server's libraries and is built with the tests and benchmarks: "
                    "deploy/install-packages server test, then deploy/build release -DBUILD_TESTING=ON");
  }
  std::string name = "cairn-eval reloc";  // what it calls itself then
  words[0] = name.data();
  execv(program.c_str(), words);
  return fail(ErrorCode::kIo, program.string() + ": cannot be started: " + std::strerror(errno));
}

int report_status(Status status) {
  if (std::fflush(stdout) != 0 && status) {
    status = fail(ErrorCode::kIo, cannot_be_written("standard output"));
  }
  if (status) return 0;
  say_error("cairn-eval", status.error().message);
  return exit_code(status.error().code);
}

int report_usage(const CLI::App& app, const CLI::ParseError& error) {
  std::string message = error.what();
  if (const auto words = app.remaining(true); app.get_subcommands().empty() && !words.empty()) {
    message = "unknown command '" + words.front() + "'" +
              did_you_mean(words.front(), {"ate", "rpe", "stats", "reloc"});
  }
  say_error("cairn-eval", message);
  std::fputs("cairn-eval --help lists all commands\n", stderr);
  return kUsageExit;
}

int run(int argc, char** argv) {
  CLI::App app(
      "Compares trajectories with truth, sums up the statistics of cairn-track, examines the relocalizer.",
      "cairn-eval");
  app.require_subcommand(1);
  app.footer(kFooter);
  app.set_version_flag("--version", "cairn-eval " + std::string(version()));
  TrajectoryArguments trajectories;
  StatsArguments stats;
  auto* ate = app.add_subcommand("ate", "absolute trajectory error after alignment");
  add_trajectory_options(*ate, trajectories);
  auto* rpe = app.add_subcommand("rpe", "relative pose error over a fixed distance, all pairs");
  add_trajectory_options(*rpe, trajectories);
  rpe->add_option("--delta", trajectories.relative.delta, "how far apart the two poses of a pair are")
      ->check(check_positive)
      ->type_name("NUMBER")
      ->capture_default_str();
  rpe->add_option_function<std::string>(
         "--delta-unit",
         [&](const std::string& name) {
           trajectories.relative.unit = name == "f"   ? DeltaUnit::kFrames
                                        : name == "m" ? DeltaUnit::kMetres
                                                      : DeltaUnit::kSeconds;
         },
         "f: matched poses, m: metres of truth, s: seconds (default)")
      ->check(CLI::IsMember({"f", "m", "s"}).description(""))
      ->type_name("f|m|s");
  auto* summary = app.add_subcommand("stats", "what files of cairn-track --stats say");
  summary->add_option("FILE", stats.files, "files written by cairn-track --stats")->required();
  summary->add_flag("--json", stats.json, "one JSON document on stdout");
  summary->footer(kStatsFooter);
  app.add_subcommand(
      "reloc",
      "which of the maps of many recordings shows an image, and from where (of a build with the "
      "tests)");
  if (argc > 1 && argv[1] == std::string_view("reloc")) return report_status(run_reloc(argv + 1));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return error.get_exit_code() == 0 ? app.exit(error) : report_usage(app, error);
  }
  if (ate->parsed()) return report_status(run_ate(trajectories));
  if (rpe->parsed()) return report_status(run_rpe(trajectories));
  return report_status(run_stats(stats));
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  try {
    return cairn::run(argc, argv);
  } catch (const std::exception& error) {
    cairn::say_error("cairn-eval", error.what());
    return 1;
  }
}
