"""Steps of the control computer, for scenes and firmware alike: estimators, adaptation, observer, guard."""
