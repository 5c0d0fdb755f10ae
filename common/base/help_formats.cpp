// SPDX-License-Identifier: Apache-2.0
#include "common/base/help_formats.h"

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <functional>
#include <sstream>
#include <vector>

namespace cairn {
namespace {

std::vector<const CLI::App*> commands_of(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App* command) { return !command->get_name().empty(); });
}

std::vector<std::string> names_of(const CLI::Option& option) {
  std::vector<std::string> names;
  for (const std::string& name : option.get_snames()) names.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) names.push_back("--" + name);
  return names;
}

/// A word below another, as "/maps/export": where a line has come to.
using Visit = std::function<void(const CLI::App& app, const std::string& path)>;

void visit_all(const CLI::App& app, const std::string& path, const Visit& visit) {
  visit(app, path);
  for (const CLI::App* command : commands_of(app))
    visit_all(*command, path + "/" + command->get_name(), visit);
}

std::string replace_all(std::string text, std::string_view what, std::string_view by) {
  for (size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + by.size()))
    text.replace(at, what.size(), by);
  return text;
}

/// The text as it stands within single quotes of a shell.
std::string shell_quoted(const std::string& text) {
  return replace_all(text, "'", "'\\''");
}

// ---- the words behind the help

constexpr std::string_view kExamples = "Examples:";

/// The names of the commands that lead to one, without the program's.
std::vector<std::string> path_to(const CLI::App& app) {
  std::vector<std::string> path;
  for (const CLI::App* level = &app; level->get_parent() != nullptr; level = level->get_parent())
    path.insert(path.begin(), level->get_name());
  return path;
}

const CLI::App& root_of(const CLI::App& app) {
  return app.get_parent() == nullptr ? app : root_of(*app.get_parent());
}

/// Whether a line of examples runs that command: its names stand there in their order, with names of maps and
/// options between them. What the example does follows behind two spaces.
bool shows(const std::string& example, const std::vector<std::string>& path) {
  const size_t begin = example.find_first_not_of(' ');
  std::istringstream words(example.substr(begin, example.find("  ", begin) - begin));
  size_t found = 0;
  for (std::string word; found < path.size() && words >> word;) found += word == path[found] ? 1 : 0;
  return found == path.size();
}

/// Those examples of a paragraph that show the command, with the lines that go on about them. With
/// `with_words`, what stands between them is taken too.
std::string examples_of(const std::string& paragraph, const std::vector<std::string>& path, bool with_words) {
  std::istringstream lines(paragraph);
  std::string chosen;
  bool is_chosen = false;
  for (std::string line; std::getline(lines, line);) {
    if (line == kExamples) continue;
    const bool goes_on = line.starts_with("   ");
    if (!goes_on) is_chosen = line.starts_with("  ") ? shows(line, path) : with_words;
    if (is_chosen) chosen += "\n" + line;
  }
  return chosen.empty() ? std::string() : std::string(kExamples) + chosen;
}

std::vector<std::string> paragraphs_of(const std::string& text) {
  std::vector<std::string> paragraphs;
  for (size_t at = 0; at < text.size();) {
    const size_t end = std::min(text.find("\n\n", at), text.size());
    paragraphs.push_back(text.substr(at, end - at));
    at = end + 2;
  }
  return paragraphs;
}

// ---- completion

struct Choice {
  std::string word;
  std::string help;
};

/// What may follow at a place: its words and options, and the program's own options, which stand anywhere.
std::vector<Choice> choices_at(const CLI::App& root, const CLI::App& app) {
  std::vector<Choice> choices;
  for (const CLI::App* command : commands_of(app))
    choices.push_back({command->get_name(), command->get_description()});
  for (const CLI::App* level : {&app, &root}) {
    for (const CLI::Option* option : level->get_options()) {
      for (const std::string& name : names_of(*option)) choices.push_back({name, option->get_description()});
    }
    if (&app == &root) break;
  }
  return choices;
}

/// "/a|/b": where a line may come to. Words that are no command, as names of maps, stay where they are.
std::string places_of(const CLI::App& root) {
  std::string places;
  visit_all(root, "", [&](const CLI::App&, const std::string& path) {
    if (!path.empty()) places += (places.empty() ? "" : "|") + path;
  });
  return places.empty() ? "/" : places;
}

std::string bash_of(const CLI::App& root) {
  std::string function = "_";
  function += replace_all(root.get_name(), "-", "_");
  std::ostringstream out;
  out << "# Completion of " << root.get_name() << " for bash, made from its --help.\n"
      << function << "() {\n  local at= word words=\n"
      << "  for word in \"${COMP_WORDS[@]:1:COMP_CWORD-1}\"; do\n    case \"$at/$word\" in\n      "
      << places_of(root) << ") at=\"$at/$word\" ;;\n    esac\n  done\n  case \"$at\" in\n";
  visit_all(root, "", [&](const CLI::App& app, const std::string& path) {
    out << "    '" << path << "') words='";
    for (const Choice& choice : choices_at(root, app)) out << choice.word << ' ';
    out << "' ;;\n";
  });
  out << "  esac\n  COMPREPLY=($(compgen -W \"$words\" -- \"${COMP_WORDS[COMP_CWORD]}\"))\n}\n"
      << "complete -o default -F " << function << ' ' << root.get_name() << '\n';
  return out.str();
}

std::string zsh_of(const CLI::App& root) {
  std::ostringstream out;
  out << "#compdef " << root.get_name() << "\n# Completion for zsh, made from its --help.\n"
      << "local at= word\nlocal -a found\nfor word in ${words[2,CURRENT-1]}; do\n  case \"$at/$word\" in\n   "
         " "
      << "(" << places_of(root) << ") at=\"$at/$word\" ;;\n  esac\ndone\ncase \"$at\" in\n";
  visit_all(root, "", [&](const CLI::App& app, const std::string& path) {
    out << "  ('" << path << "') found=(";
    for (const Choice& choice : choices_at(root, app)) {
      const std::string help = choice.help.substr(0, choice.help.find_first_of(";\n"));
      out << "\n    '" << shell_quoted(replace_all(choice.word, ":", "\\:") + ":" + help) << '\'';
    }
    out << ") ;;\n";
  });
  out << "esac\n_describe '" << root.get_name() << "' found || _files\n";
  return out.str();
}

// ---- the page of the manual

/// A text line of roff: nothing in it is a request or an escape.
std::string roff(const std::string& text) {
  std::string escaped = replace_all(replace_all(text, "\\", "\\e"), "-", "\\-");
  if (!escaped.empty() && (escaped.front() == '.' || escaped.front() == '\'')) escaped.insert(0, "\\&");
  return replace_all(replace_all(escaped, "\n.", "\n\\&."), "\n'", "\n\\&'");
}

void write_options(const CLI::App& app, std::ostringstream* out) {
  for (const CLI::Option* option : app.get_options()) {
    if (option->get_group().empty()) continue;  // hidden
    std::string words;
    for (const std::string& name : names_of(*option)) words += (words.empty() ? "" : ", ") + name;
    if (words.empty()) words = option->get_name(true);
    if (option->get_expected_max() > 0 && !option->get_positional()) words += " " + option->get_type_name();
    std::string help = option->get_description();
    if (!option->get_default_str().empty()) help += " [" + option->get_default_str() + "]";
    *out << ".TP\n\\fB" << roff(words) << "\\fR\n" << (help.empty() ? "\\&" : roff(help)) << '\n';
  }
}

void write_footer(const CLI::App& app, std::ostringstream* out) {
  const std::string footer = own_footer(app);
  if (!footer.empty()) *out << ".PP\n.nf\n" << roff(footer) << "\n.fi\n";
}

std::string man_of(const CLI::App& root) {
  std::string title = root.get_name();
  for (char& c : title) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  std::ostringstream out;
  out << ".\\\" Made from --help.\n.TH " << roff(title) << " 1\n.SH NAME\n"
      << roff(root.get_name()) << " \\- " << roff(root.get_description()) << "\n.SH SYNOPSIS\n.B "
      << roff(root.get_name()) << "\n[options]" << (commands_of(root).empty() ? "" : " command ...")
      << "\n.SH OPTIONS\n";
  write_options(root, &out);
  if (!commands_of(root).empty()) out << ".SH COMMANDS\n";
  visit_all(root, "", [&](const CLI::App& app, const std::string& path) {
    if (path.empty()) return;
    out << ".SS " << roff(root.get_name() + replace_all(path, "/", " ")) << '\n'
        << roff(app.get_description()) << '\n';
    write_options(app, &out);
    write_footer(app, &out);
  });
  if (!root.get_footer().empty()) out << ".SH NOTES\n";
  write_footer(root, &out);
  return out.str();
}

}  // namespace

std::optional<std::string> help_as(const CLI::App& app, std::string_view format) {
  if (format == "man") return man_of(app);
  if (format == "bash") return bash_of(app);
  if (format == "zsh") return zsh_of(app);
  return std::nullopt;
}

std::string own_footer(const CLI::App& app) {
  const std::string& footer = app.get_footer();
  const std::vector<std::string> path = path_to(app);
  if (path.empty()) return footer;
  const bool is_of_program = footer == root_of(app).get_footer();
  std::string own;
  for (const std::string& paragraph : paragraphs_of(footer)) {
    const bool is_example = paragraph.starts_with(kExamples);
    const std::string kept = is_example      ? examples_of(paragraph, path, !is_of_program)
                             : is_of_program ? std::string()
                                             : paragraph;
    if (!kept.empty()) own.append(own.empty() ? "" : "\n\n").append(kept);
  }
  return own;
}

std::string OwnFooter::make_footer(const CLI::App* app) const {
  const std::string footer = own_footer(*app);
  return footer.empty() ? footer : footer + "\n";
}

std::string told_help(const CLI::App& app) {
  const char* format = std::getenv("CAIRN_HELP_AS");
  const auto made = format != nullptr ? help_as(app, format) : std::nullopt;
  return made ? *made : app.help();
}

}  // namespace cairn
