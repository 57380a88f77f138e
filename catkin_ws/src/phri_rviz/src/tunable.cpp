#include "tunable.hpp"

#include <QRegularExpression>
#include <cmath>

namespace phri_rviz
{
QVector<Tunable> tunables(const dynamic_reconfigure::ConfigDescription& description)
{
  static const QRegularExpression with_unit("^(.*?)\\s*\\[([^\\[\\]]*)\\]\\s*$",
                                            QRegularExpression::DotMatchesEverythingOption);
  const Values minima = values(description.min), maxima = values(description.max), standards = values(description.dflt);
  QVector<Tunable> result;
  for (const auto& group : description.groups)
    for (const auto& parameter : group.parameters)
    {
      Tunable tunable;
      tunable.name = QString::fromStdString(parameter.name);
      tunable.meaning = QString::fromStdString(parameter.description);
      const auto match = with_unit.match(tunable.meaning);
      if (match.hasMatch())
      {
        tunable.unit = match.captured(2);
        tunable.meaning = match.captured(1);
      }
      tunable.minimum = minima.value(tunable.name, NAN);
      tunable.maximum = maxima.value(tunable.name, NAN);
      tunable.standard = standards.value(tunable.name, tunable.minimum);
      if (parameter.type == "double" && std::isfinite(tunable.minimum) && std::isfinite(tunable.maximum) &&
          tunable.minimum <= tunable.maximum)
        result.push_back(tunable);
    }
  return result;
}

Values values(const dynamic_reconfigure::Config& config)
{
  Values result;
  for (const auto& parameter : config.doubles)
    result.insert(QString::fromStdString(parameter.name), parameter.value);
  return result;
}

dynamic_reconfigure::Config config(const Values& values)
{
  dynamic_reconfigure::Config result;
  for (auto value = values.begin(); value != values.end(); ++value)
  {
    dynamic_reconfigure::DoubleParameter parameter;
    parameter.name = value.key().toStdString();
    parameter.value = value.value();
    result.doubles.push_back(parameter);
  }
  return result;
}

QString format(double value)
{
  return QString::number(value, 'g', 6);
}
}  // namespace phri_rviz
