#pragma once
#include <dynamic_reconfigure/Config.h>
#include <dynamic_reconfigure/ConfigDescription.h>

#include <QMap>
#include <QString>
#include <QVector>

namespace phri_rviz
{
using Values = QMap<QString, double>;  ///< name of a parameter -> value

/// A parameter of the experiment node that may change while it runs.
struct Tunable
{
  QString name;     ///< such as pd/stiffness
  QString meaning;  ///< without the unit
  QString unit;     ///< such as N/m; empty when the description ends without brackets
  double minimum = 0, maximum = 0, standard = 0;
};

/// Parameters of type double with finite limits, in the order of the message; whatever else it describes is left out.
QVector<Tunable> tunables(const dynamic_reconfigure::ConfigDescription& description);

Values values(const dynamic_reconfigure::Config& config);
dynamic_reconfigure::Config config(const Values& values);

/// Six digits, and an exponent where that is shorter.
QString format(double value);
}  // namespace phri_rviz
