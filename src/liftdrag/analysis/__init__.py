"""From series to answers: steady window, error bars, coefficients."""
